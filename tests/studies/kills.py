"""Kill -9 at random moments: is anything lost, does anyone survive, and does the next call end as
if nothing had been?

    python tests/studies/kills.py [--kills 50] [--seed 0] [--runs 200]

A suite of quick runs (two workers) is killed again and again, the parent in four rounds of five,
one of its workers in the fifth, at a moment drawn from the seed: some time after the start, or soon
after the journal has grown by so many lines. After each kill of the parent no process of it may be
left after GONE seconds, every line of the journal but the last one is whole, and every row that was
there before is there unchanged; then the same command is called again. When it ends, its tables are
compared with those of a run that was never disturbed, but for the columns of time, and the next
suite begins, until all kills are spent. A run whose worker was killed is "crashed" in its suite,
and made again by the call that follows.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

CASES = ("tide", "three_discs")
SOLVERS = ("pbd", "pbd[order=reverse]", "pbd[order=random]", "catching_up")
GONE = 5.0  # seconds in which whoever belongs to a killed parent must be gone
START = 3.0  # seconds: imports and workers
TIMES = {
    "seconds",
    "seconds_low",
    "seconds_high",
    "seconds_max",
    "setup_seconds",
    "compile_seconds",
    "rounds",
    "session",
    "step_max_seconds",
}
MARK = "KILLS_MARK"  # no name that the bench knows: those are part of the keys of runs


@dataclass
class Tally:
    """What happened: kills of parents and workers, rows that stood at a kill, suites that were
    compared."""

    parents: int = 0
    workers: int = 0
    late: int = 0  # the suite had ended before its kill was due
    stood: list[int] = field(default_factory=list)
    torn: int = 0
    slowest: float = 0.0  # seconds until the last worker of a killed parent was gone
    suites: int = 0
    faults: list[str] = field(default_factory=list)

    @property
    def kills(self) -> int:
        return self.parents + self.workers

    def __str__(self) -> str:
        stood = sorted(self.stood) or [0]
        return (
            f"{self.kills} kills ({self.parents} of the parent, {self.workers} of a worker), "
            f"{self.suites} suites; rows "
            f"that stood at a kill: {stood[0]} to {stood[-1]}, {sum(0 < s for s in stood)} times "
            f"more than 0; "
            f"{self.torn} torn last lines; orphans gone within {self.slowest:.2f} s; faults: "
            f"{len(self.faults)}"
        )


def command(out: Path, runs: int) -> list[str]:
    """The suite: `runs` runs of CASES with SOLVERS, two workers."""
    each = runs // (len(CASES) * len(SOLVERS))
    steps = ",".join(f"{0.05 / n:.17g}" for n in range(2, 2 + each))
    return [
        sys.executable,
        "-m",
        "nsbench",
        "run",
        *CASES,
        *(w for s in SOLVERS for w in ("-s", s)),
        "--h",
        steps,
        "-j",
        "2",
        "-o",
        str(out),
    ]


def start(out: Path, runs: int, mark: str) -> subprocess.Popen:
    with open(out.with_suffix(".said"), "w") as said:
        return subprocess.Popen(
            command(out, runs),
            env=os.environ | {MARK: mark},
            stdout=subprocess.DEVNULL,
            stderr=said,
        )


def marked(mark: str) -> list[int]:
    """Processes with this mark in their environment."""
    found = []
    wanted = f"{MARK}={mark}".encode()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if wanted in (entry / "environ").read_bytes().split(b"\0"):
                    found.append(int(entry.name))
            except OSError:
                continue
    return found


def lines(out: Path) -> list[bytes]:
    path = out / "journal.jsonl"
    return path.read_bytes().splitlines(keepends=True) if path.exists() else []


def whole(out: Path, tally: Tally) -> list[bytes]:
    """The lines of the journal; a fault for one that cannot be read, unless it is the last one and
    has no end."""
    found = lines(out)
    if found and not found[-1].endswith(b"\n"):
        tally.torn += 1
        found.pop()
    for line in found:
        try:
            json.loads(line)
        except ValueError:
            tally.faults.append(f"a line in the middle is torn: {line[:60]!r}")
    return found


def wait_for(moment: tuple[int, float], process: subprocess.Popen, out: Path) -> bool:
    """Wait until the moment of the kill, so many rows and seconds from now; False if the process
    ended before."""
    rows, seconds = moment
    begun = time.monotonic()
    before = len(lines(out))
    while process.poll() is None:
        if len(lines(out)) - before < rows:
            begun = time.monotonic()
        elif time.monotonic() - begun >= seconds:
            return True
        time.sleep(0.002)
    return False


def kill_parent(process: subprocess.Popen, mark: str, tally: Tally) -> None:
    process.send_signal(signal.SIGKILL)
    begun = time.monotonic()
    process.wait()
    tally.parents += 1
    while marked(mark) and time.monotonic() - begun < GONE:
        time.sleep(0.01)
    tally.slowest = max(tally.slowest, time.monotonic() - begun)
    left = marked(mark)
    if left:
        tally.faults.append(f"processes {left} outlived their parent by {GONE} s")
        for pid in left:
            os.kill(pid, signal.SIGKILL)


def kill_worker(process: subprocess.Popen, mark: str, rng: random.Random, tally: Tally) -> None:
    """Kill one of the parent's workers and let the suite end."""
    workers = sorted(
        pid for pid in marked(mark) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    )
    if workers:
        try:
            os.kill(rng.choice(workers), signal.SIGKILL)
            tally.workers += 1
        except ProcessLookupError:
            pass
    process.wait()


def table(out: Path) -> list[dict]:
    """runs.csv without the columns of time, as text."""
    with open(out / "runs.csv", newline="", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k not in TIMES} for row in csv.DictReader(file)]


def study(kills: int, seed: int, runs: int, folder: Path, say=print) -> Tally:
    """All kills, in as many suites as it takes. Figures and faults are in the tally."""
    rng = random.Random(seed)
    tally = Tally()
    begun = time.monotonic()
    subprocess.run(command(folder / "undisturbed", runs), check=True, stdout=subprocess.DEVNULL)
    length = time.monotonic() - begun
    want = table(folder / "undisturbed")
    say(f"undisturbed: {len(want)} runs in {length:.1f} s, {sorted({r['status'] for r in want})}")
    while tally.kills < kills and not tally.faults:
        out = folder / f"suite{tally.suites}"
        standing = []
        while True:
            mark = f"{seed}-{rng.random()}"
            process = start(out, runs, mark)
            # among the rows, to a tenth of a second; or in the seconds of the start, before any row
            moment = (
                (rng.randint(1, max(1, runs // 6)), rng.uniform(0.0, 0.1))
                if rng.random() < 0.8
                else (0, rng.uniform(0.0, START))
            )
            if tally.kills >= kills or not wait_for(moment, process, out):
                tally.late += tally.kills < kills
                process.wait()
            elif rng.random() < 0.8:
                kill_parent(process, mark, tally)
            else:
                kill_worker(process, mark, rng, tally)
            now = whole(out, tally)
            if now[: len(standing)] != standing:
                tally.faults.append(
                    f"{len(standing)} rows stood before kill {tally.kills}, not all of them do now"
                )
            standing = now
            keys = {entry["key"] for entry in map(json.loads, now) if "key" in entry}
            tally.stood.append(len(keys))
            if len(keys) > runs:
                tally.faults.append(
                    f"{len(keys)} different runs in a suite of {runs}: the calls do not know each "
                    f"other's"
                )
            if process.returncode == 0:
                break
            if process.returncode not in (3, -signal.SIGKILL):
                tally.faults.append(
                    f"the call ended with {process.returncode}: "
                    f"{out.with_suffix('.said').read_text()[-2000:]}"
                )
                break
        if process.returncode == 0 and table(out) != want:
            tally.faults.append(f"{out} differs from the undisturbed run")
        tally.suites += 1
        say(str(tally))
    return tally


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    for name, default in (("kills", 50), ("seed", 0), ("runs", 200)):
        parser.add_argument(f"--{name}", type=int, default=default)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        found = study(args.kills, args.seed, args.runs, Path(place))
    print(*found.faults, sep="\n")
    sys.exit(bool(found.faults))
