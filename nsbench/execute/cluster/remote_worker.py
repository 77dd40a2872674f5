"""What a worker of a cluster does with the runs it is sent: a process of their own computes them
and is watched.

A worker cannot stop a thread of its own that hangs in C code, and a run that dies would take the
worker with it. Here each of its threads has one process for runs, warm from task to task, under the
supervision of local workers (nsbench.execute.workers.pool): the same limits, the same rows. The
worker itself only waits, so that its scheduler hears of it all the time, with or without a nanny.
Such a process goes with the worker, or when nothing came for a while.
"""

from __future__ import annotations

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
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from nsbench.compilation import disk_cache
from nsbench.compilation.installation import processor
from nsbench.execute.workers import memory
from nsbench.execute.workers.output_capture import OutputCapture
from nsbench.execute.workers.pool import WorkerPool
from nsbench.execute.workers.process import Worker, settings
from nsbench.execute.workers.worker import work
from nsbench.results import run_key
from nsbench.results.environment import versions
from nsbench.source_files import file_state
from nsbench.source_files.package import package_digest
from nsbench.study import Spec

SLICE = (
    2.0  # seconds: a task ends with the run that passes them; what is left goes to whoever is free
)
DIGEST = re.compile(r"[0-9a-f]{16}")
LARGE = 10 << 20  # bytes: a file beyond is not sent, but must lie there
IDLE = 120.0  # seconds without a task after which the processes for a study are ended


class OtherInstallation(Exception):
    """This worker would compute other numbers than the client; the message says why."""


@functools.cache
def fingerprint() -> dict[str, str]:
    """What must be the same wherever rows of one study are computed: contents of the package,
    versions, processor, settings.

    A row is found again by a key that holds all of these (nsbench.results.run_key): the client's
    must be the worker's.
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
    files = sorted(
        (p for f in folders for p in Path(f).iterdir() if p.suffix in (".py", ".npz", ".json")),
        key=lambda p: p.name,
    )
    digest = hashlib.sha256()
    for p in files:
        digest.update(p.name.encode() + b"\0" + hashlib.sha256(p.read_bytes()).digest())
    return digest.hexdigest()[:16]


def installation_mismatch(there: dict[str, str], here: dict[str, str]) -> str:
    """How two fingerprints differ, as the end of a sentence; "" if they do not."""
    words = []
    for name in sorted({*there, *here}):
        a = there.get(name, "missing")
        b = here.get(name, "missing")
        if a != b:
            both = DIGEST.fullmatch(a) and DIGEST.fullmatch(b)
            b = "only there" if b == "missing" else "here" if DIGEST.fullmatch(b) else f"here {b}"
            a = "there" if DIGEST.fullmatch(a) else a
            words.append(
                f"{name} has other contents"
                if both or name.startswith("nsbench.") or name == "nsbench"
                else f"{name} is {a} ({b})"
            )
    return ", ".join(words)


@dataclass
class _Crew:
    """The process that one thread of this worker has for the runs of one study, and who watches
    it."""

    team: WorkerPool
    placed: dict[str, str] = field(default_factory=dict)  # where the files of the client lie here
    busy: bool = False  # its thread is at work with it
    gone: bool = False  # nobody waits for its rows: its thread ends it, soon
    since: float = field(default_factory=time.monotonic)

    def rows(self, specs: list[Spec], timeout: float | None, most: int) -> list[tuple[dict, bytes]]:
        """Row of each of the first specs and what it printed, up to the end of the slice or of the
        process."""
        team = self.team
        out = []
        printed = {}
        team.timeout, team.most, team.looked = timeout, most, time.monotonic()
        team.on_output = printed.__setitem__
        team.on_row = lambda spec, row: out.append((row, printed.pop(spec, b"")))
        for job in [j for j in team.spare if j.process.exitcode is not None]:
            team.spare.remove(job)
            job.close()
        team.assign(team.spare.pop() if team.spare else team.spawn(team.locks, 1), specs)
        while (team.working or team.alone) and not self.gone:
            team.hear()
            team.look()
            team.queue.clear()  # what a lost process left undone: the client sends it again
            team.hire(1)
        self.since = time.monotonic()
        return out


_crews: dict[tuple[str, int], _Crew] = {}  # by owner and thread
_dismissed: deque[str] = deque(
    maxlen=1000
)  # owners: a task of theirs may still be on its way to a thread
_guard = threading.Lock()  # of these two, and of who is busy


def rows_of(
    specs: list[Spec],
    timeout: float | None,
    most: int | None,
    owner: str,
    expected: dict[str, str],
    units: list[dict[str, bytes | str]],
) -> list[tuple[dict, bytes]]:
    """Row of each of the first of `specs` (of one at least, then of as many as end within SLICE)
    and what it has printed; [] if the owner was dismissed.

    timeout: seconds of one run (None: no limit); most: bytes that it may hold (None: what each
    processor of this machine can have); owner: a word for the study, see `dismiss`; expected: the
    client's fingerprint; units: see `_placed`. A row that was not made of what the client has says
    so as "unlike" (nsbench.execute.cluster.same_sources). Raises OtherInstallation.
    """
    differs = installation_mismatch(fingerprint(), expected)
    if differs:
        raise OtherInstallation(differs)
    key = owner, threading.get_ident()
    _reaper()
    with _guard:
        if owner in _dismissed:
            return []
        crew = _crews.setdefault(key, _Crew(_team()))
        crew.busy = True
    try:
        placed = _placed(units)
        moved = [
            Path(f).name for f, place in placed.items() if crew.placed.setdefault(f, place) != place
        ]
        if moved:
            raise OtherInstallation(f"{', '.join(moved)} changed there while it was used")
        return crew.rows(_moved(specs, placed), timeout, most or memory.limit(os.cpu_count() or 1))
    except BaseException:
        crew.gone = True
        raise
    finally:
        with _guard:
            crew.busy = False
            if crew.gone:
                _crews.pop(key, None)
                crew.team.end()


def dismiss(owner: str) -> None:
    """End all processes that work for `owner`, and begin none for it any more."""
    with _guard:
        _dismissed.append(owner)
        for key in [k for k in _crews if k[0] == owner]:
            _end(key)


def _end(key: tuple[str, int]) -> None:
    crew = _crews.pop(key)
    crew.gone = True
    if not crew.busy:
        crew.team.end()


@functools.cache
def _reaper() -> threading.Thread:
    """Ends processes whose client has gone without a word."""

    def reap():
        while True:
            time.sleep(IDLE / 4)
            with _guard:
                for key in [
                    k for k, c in _crews.items() if not c.busy and time.monotonic() - c.since > IDLE
                ]:
                    _end(key)

    thread = threading.Thread(target=reap, daemon=True, name="nsbench-reaper")
    thread.start()
    return thread


def _team() -> WorkerPool:
    # workers of one user share what is compiled, and so the locks
    folder = disk_cache.private_folder("locks") or Path(_folder().name)
    return WorkerPool([], None, None, None, 1, 0, str(folder), spawn=_spawn, keep=True)


@dataclass(frozen=True)
class _Process:
    """A process started by subprocess, as supervision sees those of multiprocessing."""

    started: subprocess.Popen

    @property
    def pid(self) -> int:
        return self.started.pid

    @property
    def exitcode(self) -> int | None:
        return self.started.poll()

    def kill(self) -> None:
        self.started.kill()


def _spawn(locks: str, threads: int) -> Worker:
    """A fresh process. Not by multiprocessing: a worker under a nanny is a daemon, which may not
    have children there."""
    (ours, theirs), (output, printed) = Pipe(), Pipe(duplex=False)
    env = os.environ | settings(threads) | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    kills = memory.kernel_kills()
    ear = OutputCapture(output)
    with theirs, printed:
        ends = theirs.fileno(), printed.fileno()
        process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-m",
                __name__,
                *map(str, ends),
                ear.word.hex(),
                str(os.getpid()),
                locks,
            ],
            env=env,
            pass_fds=ends,
            stdin=subprocess.DEVNULL,
        )
    return Worker(_Process(process), ours, ear, kills=kills)


@functools.cache
def _folder() -> tempfile.TemporaryDirectory:
    return tempfile.TemporaryDirectory(prefix="nsbench-files-", ignore_cleanup_errors=True)


def _moved(specs: list[Spec], places: dict[str, str]) -> list[Spec]:
    """The specs with the paths that their files have on this machine."""
    return [
        dataclasses.replace(
            s,
            file=places.get(s.file, s.file),
            solver_files=tuple(places[f] for f in s.solver_files),
        )
        for s in specs
    ]


def _placed(units: list[dict[str, bytes | str]]) -> dict[str, str]:
    """Where files of the client lie on this machine, by their paths there. A unit are files that
    need one another (a case file with modules and data), with their contents, or the digest of what
    is too large to be sent. They are used where they lie if all of a unit are the same there,
    otherwise as copies that lie to one another as the files do. Raises OtherInstallation for a
    large one that is not there."""
    return {path: place for unit in units for path, place in _place(unit).items()}


def _place(unit):
    if all(map(_lies_there, unit, unit.values())):
        return {path: path for path in unit}
    gone = [
        path
        for path, content in unit.items()
        if isinstance(content, str) and not _lies_there(path, content)
    ]
    if gone:
        raise OtherInstallation(f"{', '.join(gone)}, too large to be sent, is not the same there")
    root = os.path.commonpath([os.path.dirname(path) for path in unit])
    whole = hashlib.sha256(
        repr(sorted((os.path.relpath(p, root), c) for p, c in unit.items())).encode()
    ).hexdigest()[:16]
    out = {path: Path(_folder().name) / whole / os.path.relpath(path, root) for path in unit}
    for path, copy in out.items():
        content = unit[path] if isinstance(unit[path], bytes) else Path(path).read_bytes()
        if not _lies_there(copy, content):
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(content)
    return {path: str(copy) for path, copy in out.items()}


def _lies_there(path, content) -> bool:
    try:
        return (
            file_state.digest(str(path)) == content
            if isinstance(content, str)
            else Path(path).read_bytes() == content
        )
    except OSError:
        return False


if __name__ == "__main__":
    ends = (Connection(int(number)) for number in sys.argv[1:3])
    work(*ends, bytes.fromhex(sys.argv[3]), int(sys.argv[4]), sys.argv[5], SLICE)
