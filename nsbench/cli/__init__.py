"""The command line: the only module that prints or exits.

Exit codes: 0 fine, 1 a number is not as in the baseline, 2 usage, 3 some runs failed unexpectedly,
4 nothing or too little compared, 5 infrastructure, 130 interrupted.
"""

from __future__ import annotations

import argparse
import os
import sys

USAGE = 2
FAILED = 3
BROKEN = 5
INTERRUPTED = 130
LIMIT = "limit of one run (default: 120 s); its preparation has 5 minutes more"


def main(argv: list[str] | None = None) -> int:
    """Entry point of `nsbench`; returns the exit code."""
    for stream in (
        sys.stdout,
        sys.stderr,
    ):  # a terminal that lacks a letter is shown its number instead
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    args = parser().parse_args(argv)
    from nsbench.execute.workers.signals import stop_signals

    with stop_signals(last=argv is None):
        return _guarded(args)


def _guarded(args) -> int:
    try:
        return args.command(args)
    except (LookupError, ValueError, TypeError, FileNotFoundError) as e:
        said = (
            f"{e.strerror}: {e.filename}"
            if isinstance(e, OSError) and e.filename
            else e.args[0]
            if e.args
            else e
        )
        print(_harmless(f"nsbench: {said}"), file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        print(
            "nsbench: interrupted; what was finished is kept, the same command goes on from there",
            file=sys.stderr,
        )
        return INTERRUPTED
    except (PermissionError, IsADirectoryError, NotADirectoryError, FileExistsError) as e:
        print(_harmless(f"nsbench: {e.filename}: {e.strerror}"), file=sys.stderr)
        return USAGE
    except OSError as e:
        print(
            _harmless(f"nsbench: {f'{e.filename}: ' if e.filename else ''}{e.strerror or e}"),
            file=sys.stderr,
        )
        return BROKEN
    except Exception as e:
        if type(e).__name__ not in ("StoreError", "ClusterError"):
            raise
        print(_harmless(f"nsbench: {e}"), file=sys.stderr)
        return BROKEN


def _harmless(text: str) -> str:
    """What names and files say, without what would command a terminal; lines, and the start of one,
    stay what they are."""
    from nsbench.report.style import sanitise

    start = "\r" * text.startswith("\r")
    return start + "\n".join(
        sanitise(line, len(line) * 8 + 8) for line in text.removeprefix("\r").split("\n")
    )


def parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        "nsbench",
        description="Test bench for Filippov and complementarity systems: "
        "which method, which step, what error, at what cost.",
    )
    sub = p.add_subparsers(required=True, metavar="COMMAND")

    def add(name, function, text):
        c = sub.add_parser(name, help=text, description=text)
        c.set_defaults(command=function)
        return c

    c = add("list", lambda a: _show("list_", a), "what exists: cases, solvers, metrics")
    c.add_argument("what", nargs="?", choices=("cases", "solvers", "metrics"))
    c = add("run", lambda a: _show("run", a), "run cases with solvers and write the report")
    c.add_argument(
        "cases", nargs="*", metavar="CASE", help="such as tide or discs[n=30]; none: the suite"
    )
    c.add_argument(
        "-s", "--solver", action="append", metavar="SOLVER", help="such as pbd[order=reverse]"
    )
    for name, text in (("h", "steps"), ("tol", "tolerances"), ("k", "stiffnesses")):
        c.add_argument(
            f"--{name}", metavar="A..B", help=f"{text}: one, a list A,B,C or a range A..B"
        )
    c.add_argument("--suite", default="standard", choices=("smoke", "standard", "hard", "full"))
    c.add_argument("--tag", help="only cases with this tag")
    c.add_argument(
        "--cases",
        dest="case_files",
        action="append",
        default=[],
        metavar="PATH",
        help="case file, or folder of case files, outside the package",
    )
    c.add_argument(
        "--solvers",
        dest="solver_files",
        action="append",
        default=[],
        metavar="PATH",
        help="solver file, or folder of solver files, outside the package",
    )
    c.add_argument(
        "-j",
        "--jobs",
        type=int,
        metavar="N",
        help="workers (default: the number of cores, at most 2)",
    )
    c.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="the workers of this Dask cluster instead, such as tcp://10.0.0.1:8786",
    )
    c.add_argument("--timeout", type=float, default=120.0, metavar="S", help=LIMIT)
    c.add_argument(
        "--memory",
        metavar="SIZE",
        help="limit of one worker, such as 4G (default: its share of the machine)",
    )
    c.add_argument(
        "--plan",
        action="store_true",
        help="say what would run and why, with a forecast of time and memory, and stop",
    )
    c.add_argument(
        "--probe",
        type=float,
        default=10.0,
        metavar="S",
        help="for --plan: limit of all small runs that tell what is not known yet (default: 10 s; "
        "0: none)",
    )
    c.add_argument("-v", "--verbose", action="store_true", help="for --plan: a line for each run")
    c.add_argument("--force", action="store_true", help="run again what is already known")
    c.add_argument("-o", "--out", default="results", metavar="DIR")
    c = add("report", lambda a: _show("report", a), "write the report of results again")
    c.add_argument("dirs", nargs="+", metavar="DIR")
    c = add("show", lambda a: _show("show", a), "one case, or one run of it")
    c.add_argument("case", metavar="CASE")
    c.add_argument("-s", "--solver", metavar="SOLVER")
    for name in ("h", "tol", "k"):
        c.add_argument(f"--{name}", type=float)
    c = add("check", lambda a: _show("check", a), "check a case file or a solver file")
    c.add_argument("file")
    c = add("reference", lambda a: _show("reference", a), "build or verify stored references")
    c.add_argument("action", choices=("build", "verify", "list"))
    c.add_argument("cases", nargs="*", metavar="CASE")
    c.add_argument("--into", metavar="DIR", help="folder to use (default: reference_solutions)")
    c.add_argument(
        "--kind",
        choices=("auto", "certified", "runs"),
        default="auto",
        help="build: a proof, two runs that agree, or the first with the second as a fallback",
    )
    c.add_argument(
        "--certify", action="store_true", help="verify: make every proof again (minutes)"
    )
    c = add(
        "gate",
        lambda a: _against("gate", a),
        "compare results with a baseline: 0 as before, 1 not, 4 too little compared",
    )
    c.add_argument("dir", metavar="DIR", help="folder of results")
    c.add_argument("--baseline", required=True, metavar="FILE")
    c.add_argument(
        "--update",
        action="store_true",
        help="write what changed into the baseline (needs --reason)",
    )
    c.add_argument("--reason", metavar="TEXT", default="")
    c.add_argument("--summary", metavar="FILE", help="append a summary in Markdown to this file")
    c = add(
        "calibrate",
        lambda a: _against("calibrate", a),
        "how far the numbers of a study spread from starts 1e-12 apart",
    )
    c.add_argument("dir", nargs="?", default="results", metavar="DIR")
    c.add_argument(
        "-j",
        "--jobs",
        type=int,
        metavar="N",
        help="workers (default: the number of cores, at most 2)",
    )
    c.add_argument("--timeout", type=float, default=120.0, metavar="S", help=LIMIT)
    c = add(
        "compare", lambda a: _against("compare", a), "what differs between two folders of results"
    )
    c.add_argument("old", metavar="A")
    c.add_argument("new", metavar="B")
    c.add_argument(
        "--rtol",
        type=float,
        default=1e-6,
        metavar="R",
        help="relative difference that is none (default: 1e-6)",
    )
    add("doctor", lambda a: _show("doctor", a), "is this installation fit to measure with?")
    return p


def _show(name, args, module="commands") -> int:
    """Run a command of that module and print what it says; loaded on use, so that --help stays
    quick."""
    from importlib import import_module

    module = import_module(f"nsbench.cli.{module}")
    return getattr(module, name)(args, _say)


def _against(name, args) -> int:
    return _show(name, args, "gate_commands")


def _say(text: str = "", end: str = "\n") -> None:
    """Print; when nobody reads any more (`nsbench run | head`) the work goes on without a word."""
    try:
        print(_harmless(text), end=end, flush=True)
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
