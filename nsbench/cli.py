"""The command line: the only module that prints or exits.

Exit codes: 0 fine, 1 a number is not as in the baseline, 2 usage, 3 some runs failed unexpectedly, 4 nothing or too little
compared, 5 infrastructure, 130 interrupted.
"""
from __future__ import annotations

import argparse
import sys

USAGE, FAILED, BROKEN, INTERRUPTED = 2, 3, 5, 130


def main(argv: list[str] | None = None) -> int:
    """Entry point of `nsbench`; returns the exit code."""
    args = parser().parse_args(argv)
    try:
        return args.command(args)
    except (LookupError, ValueError, TypeError, FileNotFoundError) as e:
        print(f"nsbench: {e.args[0] if e.args else e}", file=sys.stderr)
        return USAGE
    except KeyboardInterrupt:
        print("nsbench: interrupted; what was finished is kept, the same command goes on from there", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except Exception as e:
        if type(e).__name__ != "StoreError":
            raise
        print(f"nsbench: {e}", file=sys.stderr)
        return BROKEN


def parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser("nsbench", description="Test bench for Filippov and complementarity systems: "
                                "which method, which step, what error, at what cost.")
    sub = p.add_subparsers(required=True, metavar="COMMAND")

    def add(name, function, text):
        c = sub.add_parser(name, help=text, description=text)
        c.set_defaults(command=function)
        return c
    c = add("list", lambda a: _show("list_", a), "what exists: cases, solvers, metrics")
    c.add_argument("what", nargs="?", choices=("cases", "solvers", "metrics"))
    c = add("run", lambda a: _show("run", a), "run cases with solvers and write the report")
    c.add_argument("cases", nargs="*", metavar="CASE", help="such as tide or discs[n=30]; none: the suite")
    c.add_argument("-s", "--solver", action="append", metavar="SOLVER", help="such as pbd[order=reverse]")
    for name, text in (("h", "steps"), ("tol", "tolerances"), ("k", "stiffnesses")):
        c.add_argument(f"--{name}", metavar="A..B", help=f"{text}: one, a list A,B,C or a range A..B")
    c.add_argument("--suite", default="standard", choices=("smoke", "standard", "hard", "full"))
    c.add_argument("--tag", help="only cases with this tag")
    c.add_argument("--cases", dest="case_files", action="append", default=[], metavar="PATH",
                   help="case file, or folder of case files, outside the package")
    c.add_argument("--solvers", dest="solver_files", action="append", default=[], metavar="PATH",
                   help="solver file, or folder of solver files, outside the package")
    c.add_argument("-j", "--jobs", type=int, metavar="N", help="workers (default: the number of cores, at most 2)")
    c.add_argument("--timeout", type=float, default=120.0, metavar="S", help="limit of one run (default: 120 s)")
    c.add_argument("--plan", action="store_true", help="say what would run and stop")
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
    c.add_argument("--kind", choices=("auto", "certified", "runs"), default="auto",
                   help="build: a proof, two runs that agree, or the first with the second as a fallback")
    c.add_argument("--certify", action="store_true", help="verify: make every proof again (minutes)")
    c = add("gate", lambda a: _show("gate", a), "compare results with a baseline: 0 as before, 1 not, 4 too little compared")
    c.add_argument("dir", metavar="DIR", help="folder of results")
    c.add_argument("--baseline", required=True, metavar="FILE")
    c.add_argument("--update", action="store_true", help="write what changed into the baseline (needs --reason)")
    c.add_argument("--reason", metavar="TEXT", default="")
    c.add_argument("--summary", metavar="FILE", help="append a summary in Markdown to this file")
    c = add("calibrate", lambda a: _show("calibrate", a), "how far the numbers of a study spread from starts 1e-12 apart")
    c.add_argument("dir", nargs="?", default="results", metavar="DIR")
    c.add_argument("-j", "--jobs", type=int, metavar="N", help="workers (default: the number of cores, at most 2)")
    c.add_argument("--timeout", type=float, default=120.0, metavar="S", help="limit of one run (default: 120 s)")
    c = add("compare", lambda a: _show("compare", a), "what differs between two folders of results")
    c.add_argument("old", metavar="A")
    c.add_argument("new", metavar="B")
    c.add_argument("--rtol", type=float, default=1e-6, metavar="R", help="relative difference that is none (default: 1e-6)")
    add("doctor", lambda a: _show("doctor", a), "is this installation fit to measure with?")
    return p


def _show(name, args) -> int:
    """Run a command of nsbench.commands and print what it says; loaded on use, so that --help stays quick."""
    from importlib import import_module
    module = import_module("nsbench.commands")
    return getattr(module, name)(args, lambda text="", end="\n": print(text, end=end, flush=True))
