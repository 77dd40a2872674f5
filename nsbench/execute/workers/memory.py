"""How much memory a worker may hold, how much it holds, and whether it was memory that ended it.

The limit is on resident memory, looked at from outside: what JAX and numba reserve without touching
it (address space) says nothing of what the machine has to give.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable
from pathlib import Path

# of the machine's memory for all workers together: the rest is the parent's and the system's
SHARE = 0.8
LEAST = 1 << 30  # bytes: libraries and kernels alone take half of it
NEAR = (
    0.8  # of the limit: a worker that was killed above this share of it was killed for its memory
)
UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}
CGROUPS = Path("/sys/fs/cgroup")
WORDS = (
    "RESOURCE_EXHAUSTED",
    "bad_alloc",
    "out of memory",
    "Out of memory",
    "Cannot allocate memory",
    "MemoryError",
)


def parse_size(text: str) -> int:
    """ "6G", "1.5 GiB" or "800M" in bytes. Raises ValueError for anything else."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([KMGT]?)(?:i?B)?\s*", text, re.IGNORECASE)
    size = int(float(found[1]) * UNITS[found[2].upper()]) if found else 0
    if size < 1 << 20:
        raise ValueError(f"--memory is {text!r}; a size such as 4G or 800M is needed")
    return size


def told(size: float) -> str:
    """A size for people, such as 1.5 GiB."""
    return f"{size / (1 << 30):.1f} GiB" if size >= 1 << 30 else f"{size / (1 << 20):.0f} MiB"


def limit(jobs: int) -> int:
    """Bytes that each of `jobs` workers may hold: its part of SHARE of what this process can use,
    at least LEAST."""
    return max(LEAST, int(SHARE * total() / jobs))


def total() -> int:
    """Bytes of memory that this process and its children can use: the machine's, or less where a
    container's limit says."""
    try:
        machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        machine = 8 << 30  # nobody says: what a laptop has
    return min([machine, *_limits()])


def _groups():
    """Folders of the control groups that hold this process, of both versions, up to the top."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, kinds, path = line.split(":", 2)
            if kinds in ("", "memory"):
                top = CGROUPS / kinds
                inner = top / path.strip("/")
                yield from (
                    p for p in (inner, *inner.parents) if p.is_relative_to(top) and p.is_dir()
                )


def _limits():
    for folder in _groups():
        for name in ("memory.max", "memory.limit_in_bytes"):
            with contextlib.suppress(OSError, ValueError):  # "max" is no number: no limit
                yield int((folder / name).read_text())


def held_by(pid: int, others: Iterable[int] = ()) -> int:
    """Bytes of resident memory of a process and of these others; 0 where the system does not tell.
    What several of them share counts once."""
    shares = [_share(p) for p in (pid, *others)] if others else []
    if any(shares[1:]):
        return sum(shares)
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return 0


def _share(pid: int) -> int:
    """Bytes of a process, with its part of what it shares (proc(5), smaps_rollup); 0 where it has
    ended."""
    with contextlib.suppress(OSError):
        found = re.search(
            r"^Pss:\s+(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE
        )
        return int(found[1]) << 10 if found else 0
    return 0


def started_by(leaders: Iterable[int]) -> dict[int, list[int]]:
    """The other processes of the groups that these lead: what a worker has started, unless it has
    left the group."""
    out: dict[int, list[int]] = {pid: [] for pid in leaders}
    with contextlib.suppress(OSError):
        for pid in [int(name) for name in os.listdir("/proc") if name.isdigit()]:
            with contextlib.suppress(OSError):
                if (leader := os.getpgid(pid)) in out and leader != pid:
                    out[leader].append(pid)
    return out


def kernel_kills() -> int:
    """How many processes the system has killed for want of memory so far: on the machine and in
    this container."""
    count = 0
    for path in (
        Path("/proc/vmstat"),
        *(g / n for g in _groups() for n in ("memory.events", "memory.oom_control")),
    ):
        with contextlib.suppress(OSError):
            count += sum(
                int(n) for n in re.findall(r"^oom_kill (\d+)$", path.read_text(), re.MULTILINE)
            )
    return count


def offer_first() -> None:
    """When memory runs out the system takes this process before its parent."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("800")  # of 1000


def ran_out(text: str) -> bool:
    """Does what a library wrote or raised speak of memory that was not to be had?"""
    return any(word in text for word in WORDS)
