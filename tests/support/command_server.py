"""Commands in processes of their own, each forked from one that has imported what they need.

`python -m nsbench` takes a second and more to import numpy, numba, pandas and matplotlib; a process
that is forked from one that has them begins at once, and knows nothing of the commands before it.
No file of a case or solver is loaded in the process from which they are forked.

python tests/support/command_server.py      reads and answers lines of JSON, ends with its input
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import traceback


class Commands:
    """Runs `nsbench` with arguments in a folder, as often as asked; env: of all its commands."""

    def __init__(self, folder, env=None):
        self.process = subprocess.Popen(
            [sys.executable, __file__],
            cwd=folder,
            env=env,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.process.stdin.close()
        self.process.wait(20)
        self.process.stdout.close()

    def __call__(self, *args, cwd=None, **variables):
        """The command as it has ended: returncode, stdout, stderr. variables: of its
        environment."""
        asked = {"args": [str(a) for a in args], "cwd": cwd and str(cwd), "variables": variables}
        print(json.dumps(asked), file=self.process.stdin, flush=True)
        return subprocess.CompletedProcess(args, *json.loads(self.process.stdout.readline()))


def main():
    sys.path[0] = os.getcwd()  # as of `python -m nsbench`
    import_libraries()

    exit_now = os._exit  # a command may guard it
    answer = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        asked = json.loads(line)
        with contextlib.ExitStack() as stack:
            files = [stack.enter_context(tempfile.TemporaryFile()) for _ in range(2)]
            child = os.fork()
            if child == 0:
                _command(asked, files, exit_now)
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            said = [_text(file) for file in files]
        print(json.dumps([code, *said]), file=answer, flush=True)


def import_libraries():
    """What a run and its report need, and no file of a case or solver."""
    import matplotlib.figure
    import pandas
    import pyarrow.parquet

    import nsbench.execute.suite
    import nsbench.report.assemble
    import nsbench.solvers  # noqa: F401


def _command(asked, files, exit_now):
    """Body of a forked process: the command line with its own folder, environment and output."""
    from nsbench.cli import main as command

    code = 1
    try:
        for number, file in enumerate(files, 1):
            os.dup2(file.fileno(), number)
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.environ.update(asked["variables"])
        if asked["cwd"]:
            os.chdir(asked["cwd"])
        code = command(asked["args"])
    except SystemExit as e:
        code = e.code or 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        exit_now(code)


def _text(file):
    file.seek(0)
    return file.read().decode()


if __name__ == "__main__":
    main()
