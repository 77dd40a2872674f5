"""Entry point of the command line: parse, run the verb, turn exceptions into exit codes.

Only this module prints. What names and files contain is printed without control characters, so
that no text of a case file can command the terminal. Exit codes: nsbench.cli.exit_codes.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from importlib import import_module

from nsbench.cli.arguments import build_parser
from nsbench.cli.exit_codes import BROKEN, INTERRUPTED, USAGE
from nsbench.cli.project_file import apply_project_file

Say = Callable[..., None]
# by name: their modules are not loaded here
INFRASTRUCTURE_ERRORS = ("StoreError", "ClusterError", "LostChore")


def main(argv: list[str] | None = None) -> int:
    """Run `nsbench` with these arguments and return the exit code.

    argv: the arguments without the program's name; None: those of the process. Raises SystemExit
    for --help, --print-completion and arguments that cannot be parsed, as argparse does.
    """
    for stream in (sys.stdout, sys.stderr):
        # a terminal that lacks a letter shows its code number instead
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    args = build_parser().parse_args(argv)
    args.argv = list(sys.argv[1:] if argv is None else argv)  # a report says how to repeat it
    from nsbench.execute.workers.signals import stop_signals

    with stop_signals(last=argv is None):
        return _run_verb(args)


def _run_verb(args: argparse.Namespace) -> int:
    """Run the verb; an expected exception becomes a line on standard error and an exit code."""
    try:
        apply_project_file(args)
        return import_module(f"nsbench.cli.{args.verb_module}").command(args, say)
    except KeyboardInterrupt:
        _print_error("interrupted; what was finished is kept, the same command goes on from there")
        return INTERRUPTED
    except Exception as e:
        code, message = _explain(e)
        if message is None:
            raise
        _print_error(message)
        return code


def _explain(error: Exception) -> tuple[int, str | None]:
    """Exit code and sentence of an exception; None for the sentence if it was not expected."""
    if isinstance(error, FileNotFoundError) and error.filename:
        return USAGE, f"{error.strerror}: {error.filename}"
    if isinstance(error, (LookupError, ValueError, TypeError, FileNotFoundError)):
        return USAGE, str(error.args[0] if error.args else error)
    if isinstance(error, (PermissionError, IsADirectoryError, NotADirectoryError, FileExistsError)):
        return USAGE, f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError):
        file = f"{error.filename}: " if error.filename else ""
        return BROKEN, f"{file}{error.strerror or error}"
    if type(error).__name__ in INFRASTRUCTURE_ERRORS:
        return BROKEN, str(error)
    return BROKEN, None


def say(text: str = "", end: str = "\n") -> None:
    """Print a text; when nobody reads any more (`nsbench run | head`) the work goes on silently."""
    try:
        print(_sanitise_lines(text), end=end, flush=True)
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _print_error(message: str) -> None:
    print(_sanitise_lines(f"nsbench: {message}"), file=sys.stderr)


def _sanitise_lines(text: str) -> str:
    """Escape what would command a terminal; line ends and a leading carriage return stay."""
    from nsbench.report.style import sanitise

    start = "\r" * text.startswith("\r")
    return start + "\n".join(
        sanitise(line, len(line) * 8 + 8) for line in text.removeprefix("\r").split("\n")
    )
