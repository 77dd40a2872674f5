"""A Dask cluster of worker processes on this machine, each with a nanny that restarts it, in a
process of its own.

python tests/local_cluster.py WORKERS       prints the address of the scheduler, ends with its
standard input
"""

import contextlib
import os
import subprocess
import sys
import tempfile


@contextlib.contextmanager
def cluster(workers, **env):
    """(address, process) of a cluster; env: settings such as DASK_..."""
    with tempfile.TemporaryDirectory() as folder:
        settings = os.environ | {"DASK_TEMPORARY_DIRECTORY": folder} | env
        process = subprocess.Popen(
            [sys.executable, __file__, str(workers)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=settings,
            text=True,
        )
        with process:
            try:
                yield process.stdout.readline().strip(), process
            finally:
                process.stdin.close()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(20)
                process.kill()


def main(workers):
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
    ) as own:
        print(own.scheduler_address, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(int(sys.argv[1]))
