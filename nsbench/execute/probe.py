"""Small runs in a process of their own, to measure the seconds and memory that such runs take.

The process (``python -m nsbench.execute.probe``) reads a list of specs from its standard input as
JSON and writes a line for each run that has ended; it is killed when the time is up.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import asdict

import psutil

from nsbench.results.journal import clean, restore
from nsbench.study import Spec
from nsbench.study.attempt import attempt

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def probe(specs: list[Spec], seconds: float) -> dict[Spec, dict]:
    """Run these specs for at most so many seconds in all; returns the rows of those that ended.

    A row has two columns more: `wall`, the seconds from the beginning of the run to the end of its
    measuring, and `memory`, the peak of the process so far in bytes.
    """
    rows: dict[Spec, dict] = {}
    if not specs or seconds <= 0.0:
        return rows
    process = _start_process(specs)
    stop = threading.Timer(seconds, process.kill)
    stop.start()
    try:
        for line in process.stdout:
            # a run may write lines itself, and the last line may be half a one
            with contextlib.suppress(ValueError, KeyError):
                entry = json.loads(line)
                rows[specs[entry["probe"]]] = restore(entry["row"])
    finally:
        stop.cancel()
        process.kill()
        process.wait()
        process.stdout.close()
    return rows


def _start_process(specs: list[Spec]) -> subprocess.Popen:
    paths = {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    with tempfile.TemporaryFile() as requests:
        requests.write(json.dumps([asdict(s) for s in specs]).encode())
        requests.seek(0)
        return subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=requests,
            stdout=subprocess.PIPE,
            env=os.environ | dict.fromkeys(THREADS, "1") | paths,
            stderr=subprocess.DEVNULL,
        )


def main() -> None:
    """Run the specs of standard input and print a line of JSON for each."""
    specs = [Spec(**{**s, "solver_files": tuple(s["solver_files"])}) for s in json.load(sys.stdin)]
    for i, spec in enumerate(specs):
        start = time.perf_counter()
        row = attempt(spec)[0]
        row |= {"wall": time.perf_counter() - start, "memory": _peak_memory()}
        print(json.dumps({"probe": i, "row": clean(row)}), flush=True)


def _peak_memory() -> float:
    """Largest resident memory of this process so far, in bytes."""
    try:
        import resource
    except ImportError:  # Windows
        return float(psutil.Process().memory_info().peak_wset)
    unit = 1 if sys.platform == "darwin" else 1024
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit)


if __name__ == "__main__":
    main()
