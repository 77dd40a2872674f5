"""`nsbench step`: which step or tolerance of a method meets an error asked for, and its cost."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Callable, Iterable

from nsbench import solvers
from nsbench.case import Case
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.cli.option_values import find_one_case, load_solver_files
from nsbench.compilation.announcement import announced_compilation, is_watched
from nsbench.execute.progress import Progress
from nsbench.problem import Complementarity
from nsbench.report.style import format_number, format_seconds, sanitise
from nsbench.study.plan import Spec, hand_over

DIGITS = 10  # of an accuracy, which is a number of few digits
COLUMNS = ("seconds", "error", "overlap")


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Answer for every method that takes the case; 3 if none keeps the error."""
    from nsbench.study.step_choice import cheapest, choose, demand_of

    solvers.check_positive("--budget", args.budget)
    added = load_solver_files(args)
    case = find_one_case(args.case)
    demand = demand_of(case, args.error, args.overlap)
    known = [*solvers.standard(), *added]
    asked = args.solver or [s for s in known if not solvers.get(s).refuses(case)]
    choices = []
    specs = _specs(case, asked)
    bar = Progress(specs, 1, _say_on_stderr, is_watched(), f"up to {args.budget:g} s a method")
    if not args.json:
        say(f"{case.key}: {_asked_for(demand, case.n)}")
        force = "reaction" if isinstance(case.problem, Complementarity) else "impulse"
        say(f"{'method':<28} {'needs':<16} {_cells(COLUMNS)} {force:>9}  how sure")
    for one, spec in zip(specs, asked, strict=True):
        with announced_compilation(spec):
            choices.append(choose(case, spec, demand, bar.tell, args.budget))
        bar.step(one, {"status": "ok"})
        bar.clear()
        if not args.json:
            say(_line(choices[-1], force))
    best = cheapest(choices)
    if args.json:
        found = [{k: _number(v) for k, v in dataclasses.asdict(c).items()} for c in choices]
        say(json.dumps({"cheapest": best.method if best else None, "methods": found}, indent=1))
    elif best is None:
        say("None of them keeps what is asked for, as far as is known.")
    else:
        say(
            f"Take {best.method} with {best.name} = {best.accuracy:.{DIGITS}g}: "
            f"{best.seconds:.2g} s a run, {best.sure}.{_not_asked_for(best, demand)}"
        )
    return FINE if best else FAILED


def _specs(case: Case, asked: list[str]) -> list[Spec]:
    """Return what progress counts: a search for each method, of no accuracy."""
    file = hand_over(case)
    return [Spec(case.key, spec, solvers.get(spec).accuracy, math.nan, file) for spec in asked]


def _say_on_stderr(text: str, end: str = "\n") -> None:
    """Print a line of progress; the carriage returns that redraw it stay."""
    parts = [sanitise(part, 8 * len(text) + 8) for part in text.split("\r")]
    print("\r".join(parts), end=end, file=sys.stderr, flush=True)


def _asked_for(demand, n: int) -> str:
    """What is asked for, and in which norm."""
    parts = []
    if demand.error < math.inf:
        of = f" (2-norm of its {n} coordinates, at any sample)" if n > 1 else ""
        parts.append(f"error of the state at most {demand.error:.3g}{of}")
    if demand.overlap < math.inf:
        parts.append(f"overlap at most {demand.overlap:.3g}")
    return ", ".join(parts)


def _not_asked_for(best, demand) -> str:
    """Say that the step keeps no error of the state, where none was asked for."""
    if demand.error < math.inf:
        return ""
    known = f": it is {best.error:.2g}" if best.error == best.error else ""
    return f" No error of the state was asked for{known} (--error)."


def _number(value):
    """JSON has no NaN and no infinity: they are null."""
    return value if not isinstance(value, float) or math.isfinite(value) else None


def _line(c, force: str) -> str:
    """The line of a method; force: "reaction" or "impulse", whose error is the last number."""
    if not c.is_found:
        return f"{c.method:<28} {c.why}{_needs(c)}"
    numbers = (c.seconds, c.error, c.violation, getattr(c, force))
    cells = _cells(f"{v:.2g}" if v == v else "-" for v in numbers)
    needs = f"{c.name} = {c.accuracy:.{DIGITS}g}"
    return f"{c.method:<28} {needs:<16} {cells}  {c.sure}" + (f"; {c.why}" if c.why else "")


def _needs(c) -> str:
    """Which accuracy would do, as the report writes it; "" where no run tells it."""
    if c.needs != c.needs:
        return ""
    seconds = format_seconds(c.needs_seconds)
    return f" It needs {c.name} = {format_number(c.needs)}, about {seconds} (extrapolated)."


def _cells(texts: Iterable[str]) -> str:
    return " ".join(f"{text:>9}" for text in texts)
