"""Cluster worker: a process of its own computes the runs that are sent, and is supervised.

A worker cannot stop a thread of its own that hangs in C code, and a run that dies would take the
worker with it. Here each thread of the worker has one process for runs, warm from task to task,
under the supervision of local workers (nsbench.execute.workers.pool): the same limits, the same
rows. The worker itself only waits, so that its scheduler hears from it all the time, with or
without a nanny. Such a process ends with the worker, or after a time without tasks.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from nsbench.compilation import disk_cache
from nsbench.compilation.machine_and_libraries import processor
from nsbench.execute.workers import memory
from nsbench.execute.workers.output_capture import OutputCapture
from nsbench.execute.workers.pool import WorkerPool
from nsbench.execute.workers.process import Worker, worker_environment
from nsbench.execute.workers.worker import Chore, work
from nsbench.results import run_key
from nsbench.results.environment import versions
from nsbench.source_files import file_state
from nsbench.source_files.package import package_digest
from nsbench.study import Spec

# seconds: a task ends with the run that passes them; the others go to whichever worker is free
TASK_SLICE = 2.0
DIGEST = re.compile(r"[0-9a-f]{16}")
MAX_FILE_SIZE = 10 << 20  # bytes: a larger file is not sent, but must be there
IDLE_TIMEOUT = 120.0  # seconds without a task after which the process for a study is ended
REMEMBERED_OWNERS = 1000  # studies that were dismissed


class OtherInstallation(Exception):
    """This worker would compute other numbers than the client; the message says why."""


@dataclass(frozen=True)
class Limits:
    """Limits of one run: seconds (None: none), and bytes (None: its processor's share)."""

    timeout: float | None
    memory: int | None = None


@functools.cache
def fingerprint() -> dict[str, str]:
    """Describe this installation: contents of the package, versions, processor, settings.

    All of it must be the same wherever rows of one study are computed: the key of a row holds it
    (nsbench.results.run_key). Returns digests and versions by name.
    """
    import nsbench.cases
    import nsbench.reference_solutions

    out = {"nsbench": package_digest()[:16], "processor": processor()}
    for package in (nsbench.cases, nsbench.reference_solutions):
        out[package.__name__] = _contents(package.__path__)
    starts = tuple(s for several in run_key.SETTINGS.values() for s in several)
    settings = {
        f"setting {k}": v
        for k, v in os.environ.items()
        if (k.startswith(starts) or k in run_key.LOADER) and not run_key.HARMLESS.match(k)
    }
    return out | settings | versions()


def _contents(folders) -> str:
    """Digest of the names and contents of cases or references."""
    files = sorted(
        (p for f in folders for p in Path(f).iterdir() if p.suffix in (".py", ".npz", ".json")),
        key=lambda p: p.name,
    )
    digest = hashlib.sha256()
    for p in files:
        digest.update(p.name.encode() + b"\0" + hashlib.sha256(p.read_bytes()).digest())
    return digest.hexdigest()[:16]


def installation_mismatch(there: dict[str, str], here: dict[str, str]) -> str:
    """Describe how two fingerprints differ, as the end of a sentence; "" if they do not."""
    differences = []
    for name in sorted({*there, *here}):
        a = there.get(name, "missing")
        b = here.get(name, "missing")
        if a == b:
            continue
        is_package = name == "nsbench" or name.startswith("nsbench.")
        if is_package or (DIGEST.fullmatch(a) and DIGEST.fullmatch(b)):
            differences.append(f"{name} has other contents")
            continue
        if DIGEST.fullmatch(a):
            a = "there"
        if b == "missing":
            b = "only there"
        else:
            b = "here" if DIGEST.fullmatch(b) else f"here {b}"
        differences.append(f"{name} is {a} ({b})")
    return ", ".join(differences)


@dataclass
class _RunProcess:
    """The process that one thread of this worker has for the runs of one study.

    pool: supervises it; local_paths: of the client's files, by their paths there; busy: a task is
    being done; ended: nobody waits for rows any more, and the thread at work ends the process soon;
    idle_since: by the monotonic clock.
    """

    pool: WorkerPool
    local_paths: dict[str, str] = field(default_factory=dict)
    busy: bool = False
    ended: bool = False
    idle_since: float = field(default_factory=time.monotonic)

    def rows(self, specs: list[Spec], limits: Limits) -> list[tuple[dict, bytes]]:
        """Compute the first specs, up to the end of the slice or of the process.

        Returns the row of each and what it printed.
        """
        rows: list[tuple[dict, bytes]] = []
        printed: dict[Spec, bytes] = {}
        self.pool.on_output = printed.__setitem__
        self.pool.on_row = lambda spec, row: rows.append((row, printed.pop(spec, b"")))
        self.work(specs, limits)
        return rows

    def work(self, task: list[Spec] | Chore, limits: Limits) -> None:
        """Let the process do a task, or as much of it as it does before it ends."""
        pool = self.pool
        pool.timeout = limits.timeout
        pool.memory_limit = limits.memory or memory.worker_limit(os.cpu_count() or 1)
        pool.checked_at = time.monotonic()
        pool.assign(pool.take_idle() or pool.start_process(pool.locks, 1), task)
        while (pool.busy or pool.queue_alone) and not self.ended:
            pool.receive()
            pool.enforce_limits()
            pool.queue.clear()  # what a process that died did not do: the client sends it again
            pool.start_workers(1)
        self.idle_since = time.monotonic()


_processes: dict[tuple[str, int], _RunProcess] = {}  # by owner and thread
# owners: a task of theirs may still be on its way to a thread
_dismissed: deque[str] = deque(maxlen=REMEMBERED_OWNERS)
_guard = threading.Lock()  # of these two, and of `busy`


def rows_of(
    specs: list[Spec],
    limits: Limits,
    owner: str,
    expected: dict[str, str],
    units: list[dict[str, bytes | str]],
) -> list[tuple[dict, bytes]]:
    """Compute the first of `specs`: one at least, then as many as end within TASK_SLICE.

    Returns the row of each and what it has printed; [] if the owner was dismissed. A row that was
    not made of what the client has says so as "unlike" (nsbench.execute.cluster.same_sources).

    owner: names the study, see `dismiss`; expected: the client's fingerprint; units: see
    `_place_files`. Raises OtherInstallation.
    """
    with process_for(owner, expected) as process:
        if process is None:
            return []
        local_paths = _place_files(units)
        moved = [
            Path(f).name
            for f, place in local_paths.items()
            if process.local_paths.setdefault(f, place) != place
        ]
        if moved:
            raise OtherInstallation(f"{', '.join(moved)} changed there while it was used")
        return process.rows(_with_local_paths(specs, local_paths), limits)


@contextlib.contextmanager
def process_for(owner: str, expected: dict[str, str]) -> Iterator[_RunProcess | None]:
    """Within, the process of this thread is busy for `owner`; None if that was dismissed.

    expected: the client's fingerprint. Raises OtherInstallation.
    """
    difference = installation_mismatch(fingerprint(), expected)
    if difference:
        raise OtherInstallation(difference)
    key = owner, threading.get_ident()
    _start_reaper()
    with _guard:
        known = owner not in _dismissed
        process = _processes.setdefault(key, _RunProcess(_new_pool())) if known else None
        if process is not None:
            process.busy = True
    if process is None:
        yield None
        return
    try:
        yield process
    except BaseException:
        process.ended = True
        raise
    finally:
        with _guard:
            process.busy = False
            if process.ended:
                _processes.pop(key, None)
                process.pool.stop()


def dismiss(owner: str) -> None:
    """End all processes that work for `owner`, and start none for it any more."""
    with _guard:
        _dismissed.append(owner)
        for key in [k for k in _processes if k[0] == owner]:
            _end(key)


def _end(key: tuple[str, int]) -> None:
    """End a process now, or leave that to the thread that is at work with it."""
    process = _processes.pop(key)
    process.ended = True
    if not process.busy:
        process.pool.stop()


@functools.cache
def _start_reaper() -> threading.Thread:
    """Start the thread that ends processes whose client has gone without dismissing them."""

    def reap() -> None:
        while True:
            time.sleep(IDLE_TIMEOUT / 4)
            with _guard:
                now = time.monotonic()
                for key in [
                    key
                    for key, process in _processes.items()
                    if not process.busy and now - process.idle_since > IDLE_TIMEOUT
                ]:
                    _end(key)

    thread = threading.Thread(target=reap, daemon=True, name="nsbench-reaper")
    thread.start()
    return thread


def _new_pool() -> WorkerPool:
    # workers of one user share what is compiled, and so the locks
    folder = disk_cache.private_folder("locks") or Path(_copies_folder().name)
    return WorkerPool(
        queue=[],
        timeout=None,
        on_row=None,
        on_output=None,
        threads=1,
        memory_limit=0,
        locks=str(folder),
        start_process=_start_process,
        keep_idle=True,
    )


@dataclass(frozen=True)
class _Process:
    """A process of subprocess with the interface of one of multiprocessing."""

    started: subprocess.Popen

    @property
    def pid(self) -> int:
        return self.started.pid

    @property
    def exitcode(self) -> int | None:
        return self.started.poll()

    def kill(self) -> None:
        self.started.kill()


def _start_process(locks: str, threads: int) -> Worker:
    """Start a worker process, as nsbench.execute.workers.process.spawn_worker does.

    Not by multiprocessing: a cluster worker under a nanny is a daemon, which may not have children
    there.
    """
    ours, theirs = Pipe()
    output, printed = Pipe(duplex=False)
    paths = {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    oom_kills = memory.count_oom_kills()
    capture = OutputCapture(output)
    with theirs, printed:
        ends = theirs.fileno(), printed.fileno()
        process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-m",
                __name__,
                *map(str, ends),
                capture.word.hex(),
                str(os.getpid()),
                locks,
            ],
            env=os.environ | worker_environment(threads) | paths,
            pass_fds=ends,
            stdin=subprocess.DEVNULL,
        )
    return Worker(_Process(process), ours, capture, oom_kills_before=oom_kills)


@functools.cache
def _copies_folder() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="nsbench-files-", ignore_cleanup_errors=True)


def _with_local_paths(specs: list[Spec], places: dict[str, str]) -> list[Spec]:
    """The specs with the paths that their files have on this machine."""
    return [
        dataclasses.replace(
            s,
            file=places.get(s.file, s.file),
            solver_files=tuple(places[f] for f in s.solver_files),
        )
        for s in specs
    ]


def _place_files(units: list[dict[str, bytes | str]]) -> dict[str, str]:
    """Provide the files of the client on this machine; returns their paths here by those there.

    A unit are files that need one another (a case file with modules and data), with their contents,
    or the digest of what is too large to be sent. If all files of a unit are the same on this
    machine, they are used where they are; otherwise as copies in folders that are arranged as the
    client's. Raises OtherInstallation for a large file that is not the same here.
    """
    return {path: place for unit in units for path, place in _place_unit(unit).items()}


def _place_unit(unit: dict[str, bytes | str]) -> dict[str, str]:
    if all(map(_is_same_file, unit, unit.values())):
        return {path: path for path in unit}
    missing = [
        path
        for path, content in unit.items()
        if isinstance(content, str) and not _is_same_file(path, content)
    ]
    if missing:
        raise OtherInstallation(
            f"{', '.join(missing)}, too large to be sent, is not the same there"
        )
    root = os.path.commonpath([os.path.dirname(path) for path in unit])
    digest = hashlib.sha256(
        repr(sorted((os.path.relpath(p, root), c) for p, c in unit.items())).encode()
    ).hexdigest()[:16]
    copies = {
        path: Path(_copies_folder().name) / digest / os.path.relpath(path, root) for path in unit
    }
    for path, copy in copies.items():
        content = unit[path] if isinstance(unit[path], bytes) else Path(path).read_bytes()
        if not _is_same_file(copy, content):
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(content)
    return {path: str(copy) for path, copy in copies.items()}


def _is_same_file(path: str | Path, content: bytes | str) -> bool:
    """Has a file here these contents, or the contents of this digest?"""
    try:
        if isinstance(content, str):
            return file_state.digest(str(path)) == content
        return Path(path).read_bytes() == content
    except OSError:
        return False


if __name__ == "__main__":
    ends = (Connection(int(number)) for number in sys.argv[1:3])
    work(*ends, bytes.fromhex(sys.argv[3]), int(sys.argv[4]), sys.argv[5], TASK_SLICE)
