"""Attempt one run and make its row, whatever becomes of it; repeat quick runs to time them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.columns import reserved_names
from nsbench.dynamics.scaling.estimate import case_scale
from nsbench.problem import Complementarity
from nsbench.solvers.base import Solver
from nsbench.solvers.common.initial_state import InfeasibleStart
from nsbench.solvers.scaled_run import ScaledRun
from nsbench.source_files import opened_files
from nsbench.study.plan import Spec, resolve
from nsbench.study.result_contract import contract_violation
from nsbench.trajectory import Status, Trajectory, machine_fault, utf8_safe

# relative to the size of each coordinate: far above rounding, far below any error that counts
START_PERTURBATION = 1e-12
# column `start`, by the policy of the case for an infeasible start
STARTS = {"error": "feasible", "project": "projected", "keep": "kept"}
REPEATED = "It ended once, and did not when it was repeated to be timed"
LONGEST = 10_000  # characters of a text in a row


def _announce(announce: Callable[[str, int], None], index: int, what: str) -> None:
    announce(what, index)


def run_batch(
    specs: list[Spec],
    announce: Callable[[str, int], None] = lambda what, i: None,
    order: Callable[[list[Spec]], Iterable[tuple[int, Spec]]] | None = None,
) -> Iterator[tuple[int, dict]]:
    """Yield the rows of the specs of one case, as (index, row), each as soon as it is known.

    Each spec is prepared and run once. Then all quick runs are timed in interleaved rounds, the
    first call left out, and their rows are yielded once more with median, quartiles and worst, or
    as an error where a repetition raised.
    order(specs) yields (index, spec) in the order of execution (by default that of the list).
    announce(what, i) is called before each phase: "prepare", "run", "measure", or "again" for a
    repetition.
    """
    from nsbench.measure import clock

    repeated = []
    for i, spec in order(specs) if order else enumerate(specs):
        row, run = attempt(spec, partial(_announce, announce, i))
        yield i, row
        if run is not None and timed_again(spec, row):
            repeated.append((i, row, run))
    rounds = [clock.rounds_of(row["seconds"]) for _, row, _ in repeated]
    times = clock.in_rounds(
        [run for _, _, run in repeated], rounds, lambda k: announce("again", repeated[k][0])
    )
    for (i, row, _), seconds in zip(repeated, times, strict=True):
        if isinstance(seconds, Exception):
            yield i, row | _status(_raised(seconds, f"{REPEATED}: "))
        else:
            yield i, row | clock.columns(seconds)


def timed_again(spec: Spec, row: dict) -> bool:
    """Is the run of this row repeated to be timed?

    A run is repeated if it ended well and quickly, from the case's own start.
    """
    from nsbench.measure import clock

    return (
        row["status"] in ("ok", "below_reference")
        and not spec.start_seed
        and clock.rounds_of(row["seconds"]) > 1
    )


def attempt(
    spec: Spec, announce: Callable[[str], None] = lambda what: None
) -> tuple[dict, Callable | None]:
    """Attempt one run; return its row and, if it can be timed again, the zero-argument run.

    A failure is a row as well, whatever raised.
    """
    with opened_files.record_opens_of_run(*filter(None, [spec.file, *spec.solver_files])):
        return _attempt(spec, announce)


def load_case_and_solver(spec: Spec) -> tuple[Case, Solver]:
    """Return the case of the spec and its method. Raises what their files raise."""
    _files_loaded.update(f for f in spec.solver_files if f not in _files_loaded and solvers.load(f))
    return resolve(spec.case, spec.file, spec.references), solvers.get(spec.solver)


def _attempt(spec, announce):
    from nsbench.measure import clock

    row = {
        "case": spec.case,
        "solver": spec.solver,
        "accuracy": spec.accuracy,
        "asked": spec.asked,
        "h": spec.asked,
    }
    announce("prepare")
    try:
        case, method = load_case_and_solver(spec)
        why = method.refuses(case)
        if why:
            return row | _status(Status("refused", why)), None
        if getattr(getattr(method, "claims", None), "exact", None) is not None:
            gradients = isinstance(case.problem, Complementarity)
            row["claim_norm"] = "length" if gradients else "coordinate"
        start = perturbed_start(
            case, spec.start_seed
        )  # measured against the solution from the case's own start
        run, spent = clock.prepared(lambda: ScaledRun(method, start, spec.asked))
        row |= spent
        announce("run")
        found, seconds, compiled = clock.first_call(run, lambda: announce("run"))
        row |= clock.columns([seconds])
        row["compile_seconds"] += compiled
    except Exception as e:  # a plugin may raise anything; it becomes a row
        return row | _status(_raised(e)), None
    announce("measure")
    try:
        traj = run.to_user_units(found)
        wrong = contract_violation(start, traj, spec.accuracy, spec.asked)
        if wrong:
            return row | _status(Status("error", wrong)), None
        row |= _solver_columns(spec, case, traj)
        from nsbench.measure import errors

        traj = run.check_and_convert(found)
        if spec.start_seed:  # how far the measured numbers spread is asked, no error bar
            traj = dataclasses.replace(traj, bound=None)
        row |= _status(traj.status) | errors(case, traj)
        row |= _below(row)
    except Exception as e:  # a solver may return anything
        return row | _status(_raised(e, "The run ended, measuring it did not: ")), None
    return row, run if traj.status.ok and not spec.start_seed else None


def _solver_columns(spec: Spec, case: Case, traj: Trajectory) -> dict:
    """Return the columns that the solver reports: its counted work, and the steps it took."""
    reserved = reserved_names()
    counted = {
        utf8_safe(k): utf8_safe(v)[:LONGEST] if isinstance(v, str) else v
        for k, v in traj.stats.items()
        if isinstance(k, str) and isinstance(v, (int, float, str, bool)) and k not in reserved
    }
    h = {"h": counted.get("h", spec.asked), "k": 1.0 / spec.asked}.get(spec.accuracy, spec.asked)
    return counted | {"start": STARTS[case.start], "h": h, "lam_time": traj.lam_time}


def run_one(spec: Spec, announce: Callable[[str], None] = lambda what: None) -> dict:
    """Return the row of one run.

    But for the columns of the clock it depends on nothing but the spec and what that names.
    """
    return attempt(spec, announce)[0]


def lost_run_row(spec: Spec, status: str, why: str) -> dict:
    """Return the row of a run whose process ended before it could send one."""
    h = 1.0 / spec.asked if spec.accuracy == "k" else spec.asked
    return dict(
        case=spec.case,
        solver=spec.solver,
        accuracy=spec.accuracy,
        asked=spec.asked,
        h=h,
        status=status,
        check="",
        why=utf8_safe(why),
    )


def _raised(e: Exception, when: str = "") -> Status:
    """Return the status of a run that raised: "oom" (Python or XLA), no start, or "error".

    An exception of a plugin may fail to describe itself: its __str__, or that of its cause, raises.
    """
    try:
        return _describe_exception(e, when)
    except Exception as in_text:
        raised = type(in_text).__name__
        sentence = f"{type(e).__name__}, whose text cannot be made: its __str__ raises {raised}."
        return Status("error", when + sentence)


def _describe_exception(e: Exception, when: str) -> Status:
    if isinstance(e, InfeasibleStart):
        return Status(e.code, f"No start: {e}.")
    if isinstance(e, MemoryError) or "RESOURCE_EXHAUSTED" in str(e):
        return Status("oom", f"{when}Out of memory: {e}")
    return Status("error", f"{when}{type(e).__name__}: {e}{machine_fault(e)}")


def perturbed_start(case: Case, seed: int) -> Case:
    """Return the case from a start START_PERTURBATION away; the case itself for the seed 0.

    The displacement is relative to the sizes of the coordinates in the units of the case, with
    uniform factors in (-1, 1) drawn with the seed.
    """
    if not seed:
        return case
    direction = np.random.default_rng(seed).uniform(-1.0, 1.0, case.n)
    sizes = np.maximum(case_scale(case).state, np.abs(case.x0))
    return case.replace(x0=case.x0 + START_PERTURBATION * sizes * direction)


def _below(row: dict) -> dict:
    """Return the status of a run that is right as far as its reference can tell, else no column.

    Its errors of state and impulses (or of the reaction, where the column `compared` says so or
    impulses are not known) are below ten times the bound of the reference.
    """
    below = row.get("below", "").split()
    names = (row.get("compared") or "impulse", "reaction")
    force = next((name for name in names if np.isfinite(row[name])), None)
    if row["status"] != "ok" or "state_sup" not in below or (force and force not in below):
        return {}
    return _status(
        Status(
            "below_reference",
            f"The error is below {row['state_floor']:.2g}, ten times the bound of the "
            f"reference ({row['reference']}).",
        )
    )


_files_loaded: set[str] = set()


def _status(status: Status) -> dict:
    why = "" if status.ok else utf8_safe(str(status))
    middle = " ... " if len(why) > LONGEST else ""
    return {
        "status": status.code,
        "check": status.check,
        "why": why[: LONGEST // 2] + middle + why[max(LONGEST // 2, len(why) - LONGEST // 2) :],
    }
