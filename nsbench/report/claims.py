"""Read, from the stored descriptions, what each solver claims and the time span of each case.

The descriptions come from files: what is missing or no positive number stands for no claim.
"""

from __future__ import annotations

import math

from nsbench.report.data import Data


def stored_claims(data: Data, solver: str) -> dict:
    """Return the stored claims of a solver (`nsbench.solvers.base.Claims`); {} without any."""
    return data.solvers.get(solver, {}).get("claims") or {}


def find_expectation(case: dict, solver: dict) -> dict:
    """Find what is expected, from the stored descriptions of a case and a solver.

    Returns a dict with state, impulse and why. A value is None (nothing is claimed), an order,
    ("bound", error), or a word: "exact", "plateau", "diverges", "open", "refused" or another
    status.
    """
    classes = set(case.get("classes") or ())
    for e in solver.get("expects") or ():
        if set(e["when"]) <= classes:
            return e
    claims = solver.get("claims") or {}
    bound = claims.get("exact")
    why = "the method's claim"
    if bound is not None:
        return {"state": ("bound", bound), "impulse": None, "why": why}
    return {"state": claims.get("state"), "impulse": claims.get("impulse"), "why": why}


def claims_on(data: Data, case: str, solver: str) -> dict:
    """Return what a solver claims on one case: no order where it expects an open one."""
    expected = find_expectation(data.cases.get(case, {}), data.solvers.get(solver, {}))
    is_open = {name: None for name in ("state", "impulse") if expected[name] == "open"}
    return stored_claims(data, solver) | is_open


def claimed(data: Data, solver: str, name: str) -> float:
    """Return a claimed order, bound or factor of rounding by its name; 0 if there is none."""
    return _positive(stored_claims(data, solver).get(name), 0.0)


def run_length(data: Data, case: str) -> float:
    """Return the length of the runs of a case, in its unit of time; 1 if it is not stored."""
    return _positive(data.cases.get(case, {}).get("T"), 1.0)


def rounding_span(data: Data, case: str, solver: str) -> float:
    """Return the time over which rounding adds up: the length of a run, as many times as the
    rounding of one addition per step can appear in the result of the solver."""
    return run_length(data, case) * (claimed(data, solver, "rounding") or 1.0)


def _positive(value: object, otherwise: float) -> float:
    """A positive finite number, or what stands for all else."""
    number = isinstance(value, (int, float)) and 0 < value < math.inf
    return float(value) if number else otherwise
