"""A few runs in a process of their own, to learn what such runs take: ``python -m
nsbench.execute.probe``.

Reads a list of specs from its input as JSON and writes a line for each run that has ended. Who
started it stops it when the time is up.
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

from nsbench.results.journal import clean, restore
from nsbench.study import Spec
from nsbench.study.attempt import attempt

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def probe(specs: list[Spec], seconds: float) -> dict[Spec, dict]:
    """Rows of the specs whose runs have ended within so many seconds in all, with `wall`, the
    seconds from the beginning of the run to the end of its measuring, and `memory`, the peak of the
    process so far in bytes."""
    found: dict[Spec, dict] = {}
    if not specs or seconds <= 0.0:
        return found
    env = (
        os.environ
        | dict.fromkeys(THREADS, "1")
        | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    )
    with tempfile.TemporaryFile() as asked:
        asked.write(json.dumps([asdict(s) for s in specs]).encode())
        asked.seek(0)
        process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=asked,
            stdout=subprocess.PIPE,
            env=env,
            stderr=subprocess.DEVNULL,
        )
    stop = threading.Timer(seconds, process.kill)
    stop.start()
    try:
        for line in process.stdout:
            with contextlib.suppress(
                ValueError, KeyError
            ):  # a line that a run wrote itself, or half a one
                entry = json.loads(line)
                found[specs[entry["probe"]]] = restore(entry["row"])
    finally:
        stop.cancel()
        process.kill()
        process.wait()
        process.stdout.close()
    return found


def main() -> None:
    specs = [Spec(**{**s, "solver_files": tuple(s["solver_files"])}) for s in json.load(sys.stdin)]
    for i, spec in enumerate(specs):
        start = time.perf_counter()
        row = attempt(spec)[0]
        row |= {"wall": time.perf_counter() - start, "memory": _peak()}
        print(json.dumps({"probe": i, "row": clean(row)}), flush=True)


def _peak() -> float:
    try:
        import resource
    except ImportError:
        return 0.0
    return float(
        resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        * (1 if sys.platform == "darwin" else 1024)
    )


if __name__ == "__main__":
    main()
