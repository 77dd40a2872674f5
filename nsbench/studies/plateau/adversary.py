"""Adversarial search for a plateau: scenes and sweep orders with the largest e(h/4) / e(h).

e(h) is the largest state error of PBD over three steps near h: single errors turn with the phase of
the step, and a ratio of two of them says nothing. For errors of order 1 the ratio is 1/4, for a
plateau 1. Random restarts over families of scenes, then local moves: one parameter is changed, or
the order of the sweep, and the change is kept if the ratio grows.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from nsbench.case import Case, get_case
from nsbench.case.spec import format_value
from nsbench.reference import Reference
from nsbench.solvers import solve
from nsbench.studies.plateau.scenes import CORNER, find_scene
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.truth import follow_events

COARSE = (64, 71, 77)  # steps between samples of e(h)
REFINED = 4  # times as many for e(h/4)
RESOLVED = 1e3  # times the bound of the true solution: a smaller error gives no ratio
# families of scenes: parameter -> (smallest, largest, whole number?)
FAMILIES = {
    CORNER: {"psi": (1.0, 179.0, False), "swell": (0.1, 0.9, False), "lean": (0.0, 0.45, False)},
    "buckling_row": {"n": (3, 6, True), "bend": (1e-4, 0.3, False), "gap": (0.02, 0.3, False)},
    "discs": {"n": (3, 6, True), "seed": (0, 999, True), "w": (0.0, 2.0, False)},
    "kissing": {"n": (4, 12, True), "seed": (0, 999, True), "loops": (0.0, 0.9, False)},
    "chain": {"links": (2, 12, True), "slack": (0.05, 0.6, False), "growth": (0.1, 2.0, False)},
    "overlap_start": {"n": (3, 6, True), "seed": (0, 999, True), "spread": (1.0, 2.0, False)},
}
FIXED = {"overlap_start": ",meaning=project"}
ORDERS = ("sorted", "reverse", "random")
MAX_ORDER_SEED = 99


@dataclass(frozen=True)
class Attempt:
    """One configuration: family with its parameters, method with its order; ratio e(h/4) / e(h).

    ratio: NaN where there is none (the true solution failed, a run failed, or the error is too
    small); why: the reason.
    """

    key: str
    family: str
    params: dict
    method: str
    ratio: float
    error: float
    why: str = ""


def search(seed: int, restarts: int, moves: int) -> dict:
    """Search from `restarts` random configurations with `moves` local moves each.

    Returns the best of every restart, the number of configurations tried, and what failed.
    """
    rng = np.random.default_rng(seed)
    truths: dict[str, tuple[Case, Reference | None]] = {}
    found = []
    tried = []
    for restart in range(restarts):
        family = list(FAMILIES)[restart % len(FAMILIES)]
        best = _try(family, _draw(rng, family), _draw_method(rng), truths)
        tried.append(best)
        for _ in range(moves):
            other = _try(*_move(rng, best), truths)
            tried.append(other)
            if other.ratio > best.ratio or np.isnan(best.ratio):
                best = other
        found.append(best)
    failed: dict[str, int] = {}
    for attempt in tried:
        if attempt.why:
            failed[attempt.why] = failed.get(attempt.why, 0) + 1
    ranked = sorted(found, key=lambda a: -1.0 if np.isnan(a.ratio) else a.ratio, reverse=True)
    return {
        "tried": len(tried),
        "measured": int(sum(not np.isnan(a.ratio) for a in tried)),
        "ratios": [a.ratio for a in tried if not np.isnan(a.ratio)],
        "failed": failed,
        "best": [asdict(a) for a in ranked if not np.isnan(a.ratio)],
    }


def _draw(rng: np.random.Generator, family: str) -> dict:
    return {name: _draw_value(rng, *limits) for name, limits in FAMILIES[family].items()}


def _draw_value(rng: np.random.Generator, low: float, high: float, whole: bool) -> float:
    """Draw a whole number evenly, a positive one by its logarithm if it spans a decade."""
    if whole:
        return int(rng.integers(low, high + 1))
    if low > 0.0 and high / low >= 10.0:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.3g}")
    return float(f"{rng.uniform(low, high):.3g}")


def _draw_method(rng: np.random.Generator) -> str:
    order = ORDERS[rng.integers(len(ORDERS))]
    if order == "random":
        return f"pbd[order=random,seed={rng.integers(MAX_ORDER_SEED + 1)}]"
    return "pbd" if order == "sorted" else f"pbd[order={order}]"


def _move(rng: np.random.Generator, best: Attempt) -> tuple[str, dict, str]:
    """Change one parameter to a value between its own and a drawn one, or the order."""
    names = list(best.params)
    k = int(rng.integers(len(names) + 1))
    if k == len(names):
        return best.family, best.params, _draw_method(rng)
    low, high, whole = FAMILIES[best.family][names[k]]
    value = _draw_value(rng, low, high, whole)
    if not whole:
        share = rng.uniform(0.1, 1.0)
        value = float(f"{best.params[names[k]] * (1.0 - share) + value * share:.3g}")
    return best.family, {**best.params, names[k]: value}, best.method


def _try(family: str, params: dict, method: str, truths: dict) -> Attempt:
    inner = ",".join(f"{k}={format_value(v)}" for k, v in params.items())
    key = f"{family}[{inner}{FIXED.get(family, '')}]"
    if key not in truths:
        truths[key] = _find(key)
    case, truth = truths[key]
    nothing = float("nan")
    if truth is None:
        why = "no such scene" if case is None else "no true solution"
        return Attempt(key, family, params, method, nothing, nothing, why)
    coarse = largest_error(case, truth, method, COARSE)
    fine = largest_error(case, truth, method, [REFINED * n for n in COARSE])
    if not np.isfinite(coarse + fine):
        return Attempt(key, family, params, method, nothing, coarse, "a run failed")
    if coarse < RESOLVED * truth.state_error:
        return Attempt(key, family, params, method, nothing, coarse, "no error to speak of")
    return Attempt(key, family, params, method, fine / coarse, coarse)


def _find(key: str) -> tuple[Case | None, Reference | None]:
    from nsbench.reference import reference

    try:
        case = find_scene(key) if key.startswith(CORNER) else get_case(key)
    except ValueError:  # parameters that do not go together
        return None, None
    return case, reference(case) or follow_events(case)


def largest_error(case: Case, truth: Reference, method: str, substeps) -> float:
    """Return the largest state error over steps; NaN where a run does not end well."""
    spacing = float(np.diff(case.t).min())
    worst = 0.0
    for n in substeps:
        traj = solve(case, method, h=spacing / n)
        if traj.status.code not in USABLE:
            return float("nan")
        worst = max(worst, float(np.abs(traj.x - truth.x).max()))
    return worst
