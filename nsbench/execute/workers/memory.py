"""Memory of workers: how much each may use, how much it uses, and whether it died for want of it.

The limit is on resident memory, measured from outside by psutil: what JAX and numba reserve without
touching it (address space) says nothing of what the machine has to give. Limits of containers
(control groups of Linux, both versions) and the kernel's count of processes that it killed for want
of memory are read here.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import psutil

# of the machine's memory for all workers together: the rest is the parent's and the system's
SHARE_OF_MACHINE = 0.8
SMALLEST_LIMIT = 1 << 30  # bytes: libraries and kernels alone take half of it
# of the limit: a worker that was killed while it used more than that was killed for its memory
SUSPICIOUS_SHARE = 0.8
UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
SMALLEST_SIZE = 1 << 20  # bytes that a user can ask for: less is a missing unit
CGROUPS = Path("/sys/fs/cgroup")
SHORTAGE_WORDS = (
    "RESOURCE_EXHAUSTED",
    "bad_alloc",
    "out of memory",
    "Out of memory",
    "Cannot allocate memory",
    "MemoryError",
)
OOM_SCORE = "800"  # of 1000: the kernel takes a worker before its parent, whose score is 0


def parse_size(text: str) -> int:
    """Convert "6G", "1.5 GiB" or "800M" to bytes. Raises ValueError for anything else."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([KMGT]?)(?:i?B)?\s*", text, re.IGNORECASE)
    size = int(float(match[1]) * UNITS[match[2].upper()]) if match else 0
    if size < SMALLEST_SIZE:
        raise ValueError(f"--memory is {text!r}; a size such as 4G or 800M is needed")
    return size


def worker_limit(jobs: int) -> int:
    """Bytes that each of `jobs` workers may use: its part of SHARE_OF_MACHINE of what there is."""
    return max(SMALLEST_LIMIT, int(SHARE_OF_MACHINE * total_memory() / jobs))


def total_memory() -> int:
    """Bytes that this process and its children can use: the machine's, or a container's limit."""
    return min([psutil.virtual_memory().total, *_container_limits()])


def _control_groups() -> Iterator[Path]:
    """Folders of the control groups of this process, of both versions, up to the top."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, kinds, path = line.split(":", 2)
            if kinds in ("", "memory"):
                top = CGROUPS / kinds
                inner = top / path.strip("/")
                yield from (
                    p for p in (inner, *inner.parents) if p.is_relative_to(top) and p.is_dir()
                )


def _container_limits() -> Iterator[int]:
    for folder in _control_groups():
        for name in ("memory.max", "memory.limit_in_bytes"):
            with contextlib.suppress(OSError, ValueError):  # "max" is no number: no limit
                yield int((folder / name).read_text())


def resident_memory(pid: int, others: Iterable[int] = ()) -> int:
    """Bytes of resident memory of a process and of these others; 0 if the process has ended.

    What several of them share counts once where the system knows the proportional set size (Linux);
    elsewhere it counts for the process alone, and the others are left out.
    """
    shares = [_proportional_memory(p) for p in (pid, *others)] if others else []
    if any(shares[1:]):
        return sum(shares)
    with contextlib.suppress(psutil.Error):
        return psutil.Process(pid).memory_info().rss
    return 0


def _proportional_memory(pid: int) -> int:
    """Bytes of a process with its part of what it shares (PSS); 0 if that is not known."""
    with contextlib.suppress(psutil.Error):
        return getattr(psutil.Process(pid).memory_full_info(), "pss", 0)
    return 0


def started_processes(leaders: Iterable[int]) -> dict[int, list[int]]:
    """The processes that each of these has started, by its id, itself left out.

    With POSIX these are the members of its process group, also those whose parent has ended; a
    process that leaves the group is not counted. Elsewhere they are its descendants.
    """
    started: dict[int, list[int]] = {pid: [] for pid in leaders}
    if hasattr(os, "getpgid"):
        for pid in psutil.pids():
            with contextlib.suppress(OSError):
                leader = os.getpgid(pid)
                if leader in started and leader != pid:
                    started[leader].append(pid)
        return started
    for pid in started:
        with contextlib.suppress(psutil.Error):
            started[pid] = [child.pid for child in psutil.Process(pid).children(recursive=True)]
    return started


def count_oom_kills() -> int:
    """Processes that the kernel has killed so far for want of memory: machine and container."""
    count = 0
    for path in (
        Path("/proc/vmstat"),
        *(g / n for g in _control_groups() for n in ("memory.events", "memory.oom_control")),
    ):
        with contextlib.suppress(OSError):
            counts = re.findall(r"^oom_kill (\d+)$", path.read_text(), re.MULTILINE)
            count += sum(map(int, counts))
    return count


def prefer_as_oom_victim() -> None:
    """Make the kernel take this process before its parent when memory runs out (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE)


def mentions_shortage(text: str) -> bool:
    """Does a text that a library wrote or raised speak of memory that could not be had?"""
    return any(word in text for word in SHORTAGE_WORDS)
