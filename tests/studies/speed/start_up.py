"""Start-up: `nsbench list` and `--help` over `python -c "import numpy"`, and the standard suite,
cold and warm.

    python tests/studies/speed/start_up.py                    (--suite none to skip the suite,
    --suite smoke, -j 2)

The first two are medians of ratios within interleaved rounds of fresh processes. Cold: every cache
of compiled code (numba's and JAX's) in a new empty folder. Warm: the same folder, `--force`, so
that every run is made again. Seconds on the wall and of processors; with other work on the machine
only the latter mean anything.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from nsbench.measure.clock import interleaved, ratio
from nsbench.results.environment import versions

ROUNDS = 9


def process(*argv):
    def run():
        subprocess.run([sys.executable, *argv], check=True, stdout=subprocess.DEVNULL)

    return run


def start_up():
    """Ratios of the commands' seconds to those of importing numpy."""
    runs = {
        "import numpy": process("-c", "import numpy"),
        "list": process("-m", "nsbench", "list"),
        "--help": process("-m", "nsbench", "--help"),
    }
    times = interleaved(runs, rounds=ROUNDS, least=0.0)
    print(f"python -c 'import numpy': {times['import numpy'].median:.3f} s")
    for name in ("list", "--help"):
        print(
            f"nsbench {name}: {times[name].median:.3f} s, "
            f"{ratio(times[name], times['import numpy'])} times import numpy"
        )


def suite(name: str, jobs: int):
    """Wall and processor seconds of the suite, first with empty caches, then with what that
    left."""
    with tempfile.TemporaryDirectory(prefix="nsbench-start-") as folder:
        env = os.environ | {
            "XDG_CACHE_HOME": folder,
            "NUMBA_CACHE_DIR": str(Path(folder) / "numba"),
        }
        for word, more in (("cold", ()), ("warm", ("--force",))):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            start = time.perf_counter()
            done = subprocess.run(
                [
                    sys.executable,
                    "-m",
                    "nsbench",
                    "run",
                    "--suite",
                    name,
                    "-j",
                    str(jobs),
                    *more,
                    "-o",
                    str(Path(folder) / "out"),
                ],
                env=env,
                capture_output=True,
                text=True,
            )
            wall = time.perf_counter() - start
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(
                f"{name} suite, {word}, {jobs} workers: {wall:.0f} s on the wall, {spent:.0f} s "
                f"of processors, "
                f"exit code {done.returncode}; "
                f"{done.stdout.strip().splitlines()[0] if done.stdout else done.stderr}",
                flush=True,
            )


def main():
    p = argparse.ArgumentParser()
    p.add_argument("--suite", default="standard", help="none, smoke, standard, hard or full")
    p.add_argument("-j", "--jobs", type=int, default=2)
    args = p.parse_args()
    print(
        f"python {versions()['python']}, numpy {versions()['numpy']}, numba "
        f"{versions()['numba']}, jax {versions()['jax']}; "
        f"load average {os.getloadavg()[0]:.1f} of {os.cpu_count()} cores"
    )
    start_up()
    if args.suite != "none":
        suite(args.suite, args.jobs)


if __name__ == "__main__":
    main()
