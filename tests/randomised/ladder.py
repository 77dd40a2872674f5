"""The steps that methods of a claimed order are run with, and what else than the method stands in
their errors."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.rounding import largest_speed
from nsbench.problem import LCS, Complementarity, Filippov, Smooth
from nsbench.solvers.common.extrapolation import weights
from nsbench.solvers.nosnoc.diagnostics import LEAK

LADDER = {"h": (3, 11, 43, 683), "k": (100.0, 400.0, 1600.0, 6400.0)}
LATER = {"h": (2731, 10923, 43691), "k": (25600.0, 102400.0)}
LATER_SLOW = {
    "h": (171, 683, 2731),
    "k": (6400.0, 25600.0, 102400.0),
}  # of loops that take a hundred times as long
SLOW_LOOPS = (
    "kdtree",
    "nosnoc",
    "pbd_jax",
    "backend",
    "nonlinear",
    "method=catching_up,",
    "penalty",
)
# times the largest constant of steps so many times coarser
M = 4.0
COARSER = 8.0
EPS = 2.3e-16
# steps of a run, and of implicit loops, which take 20 us for one: uneven samples may be 1e4 to the
# smallest spacing
MOST = 4e6
MOST_IMPLICIT = 1e6
MOST_SLOW = 1e4
IMPLICIT = ("implicit", "theta")
ANSWER = 10.0  # tolerances of the answer
# times of a run between which jumps of the drift are looked for; what is one, of its largest speed
LOOKS = 400
JUMP = 1e-3
# tolerances of its integrator that a penalty says to hide (see penalty: 190 were measured)
INTEGRATOR = 200.0


def is_slow(case, spec: str) -> bool:
    return any(word in spec for word in SLOW_LOOPS) or any(
        isinstance(c, Smooth) for c in getattr(case.problem, "constraints", ())
    )


def values(case, spec, method, ladder) -> list[float]:
    """h or k of a ladder for this case."""
    if method.accuracy == "k":
        return [k * stiffness(case) for k in ladder["k"]]
    spacing = float(np.diff(case.t).min())
    if spec == "nosnoc":  # a nonlinear program for each step
        return [spacing / n for n in (1, 2)] if ladder is LADDER else [spacing / n for n in (5, 17)]
    steps = (case.t[-1] - case.t[0]) / spacing  # so that a ladder takes as many steps in all, about
    most = (
        MOST_SLOW
        if is_slow(case, spec)
        else MOST_IMPLICIT
        if any(word in spec for word in IMPLICIT)
        else MOST
    )
    scale = max(1.0, 30.0 / steps)
    most = max(1, int(most / steps))
    return [spacing / n for n in sorted({min(most, max(1, round(n * scale))) for n in ladder["h"]})]


def stiffness(case) -> float:
    """What k is multiplied by, for gradients and for the length of the run."""
    soft = (
        [np.abs(c.data).min() ** -2 for c in case.problem.constraints if hasattr(c, "data")]
        if isinstance(case.problem, Complementarity)
        else []
    )
    return max([1.0, *soft]) / min(float(case.t[-1] - case.t[0]), 1.0)


def floors(
    case, method, answer, digits: float, bound: float, condition: float, unit: float, jump: float
):
    """h (or 1 / k) -> errors below it are none of the method: of the answer (whose tolerance
    `digits` is absolute too), of rounding in every step (a spacing of the largest coordinate each),
    of the integrator of a penalty; and those of which no ladder tells a constant: the part of a
    step in which the drift jumps, from nothing to all of it, is chance."""
    T = float(case.t[-1] - case.t[0])
    moved = max(unit, float(np.abs(answer.x - answer.x[0]).max()))
    least = 10.0 * bound + ANSWER * digits / moved * condition
    large = max(1.0, float(np.abs(answer.x).max()) / moved)

    jump *= condition / moved
    chatters = isinstance(case.problem, Filippov) and getattr(method, "implicit", None) is False

    def floor(h: float) -> float:
        if hasattr(method, "comp_tol"):  # what nosnoc claims ends there
            return least + LEAK * method.comp_tol * condition / moved + jump * h
        if chatters:  # by the motion of a step, which some samples happen not to show
            return (
                least
                + h * largest_speed(case.problem, float(case.t[0]), case.x0) / moved
                + EPS * T / h * condition * large
                + jump * h
            )
        if method.accuracy == "h":
            return least + EPS * T / h * condition * large + jump * h
        tol = method.tolerance("rtol", 1.0 / h) * float(np.abs(weights(method.extrapolate)).sum())
        return least + (EPS * 1e4 + INTEGRATOR * tol) * condition * max(
            large, (1.0 if unit > 1e-3 else unit) / moved
        )

    return floor


def jumps(case, answer) -> float:
    """What all jumps in time add up to of the drift along the answer, or of that field of a
    Filippov system that has most."""
    with np.errstate(all="ignore"):
        return max((_jumps(f, answer) for f in _drifts(case)), default=0.0)


def _drifts(case) -> list:
    """(t, x) -> (n,): what may jump in time; the inputs of a circuit."""
    p = case.problem
    if isinstance(p, LCS):
        return [lambda t, x, f=as_numpy(f): np.asarray(f(t), float) for f in (p.u, p.q) if f]
    if isinstance(p, Complementarity):
        return [as_numpy(p.drift)]
    field = as_numpy(p.field)
    d = len(np.atleast_1d(as_numpy(p.switch)(float(case.t[0]), case.x0.copy())))
    return [
        lambda t, x, s=s: field(t, x.copy(), np.array(s)) for s in product((1.0, -1.0), repeat=d)
    ]


def _jumps(f, answer) -> float:
    times = np.unique(np.append(np.linspace(answer.t[0], answer.t[-1], LOOKS), answer.t))
    states = [answer.x[k] for k in np.searchsorted(answer.t, times[:-1], side="right") - 1]
    least = JUMP * max(
        float(np.abs(np.nan_to_num(f(t, x), posinf=0.0, neginf=0.0)).max(initial=0.0))
        for t, x in zip(times[:-1], states, strict=True)
    )
    total = 0.0
    for (start, end), x in zip(pairwise(times), states, strict=True):
        apart = lambda a, b, x=x: float(np.abs(f(b, x) - f(a, x)).max(initial=0.0))
        a = start
        b = end
        while apart(a, b) > least and b - a > 1e-12 * (times[-1] - times[0]):
            middle = 0.5 * (a + b)
            a, b = (a, middle) if apart(a, middle) > 0.5 * apart(a, b) else (middle, b)
        if apart(a, b) > max(
            least, 2.0 * (apart(start, a) + apart(b, end))
        ):  # of a pole these are as large
            total += apart(a, b)
    return total


def slower(found, p: float, floor) -> bool:
    """Is the finest error above M times what the largest constant of those COARSER or more allows?

    Of those less than M times coarser even an error that stays would be allowed.
    """
    h, err = found[-1]
    allowed = max((e * (h / g) ** p for g, e in found[:-1] if g > COARSER * h), default=0.0)
    return not (err <= floor(h) or err <= M * allowed)
