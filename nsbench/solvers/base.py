"""The protocol of a solver, its claims, and the one grid of fixed-step methods.

A solver is a frozen dataclass whose fields are its options, with
    accuracy   the name of its accuracy parameter: "h", "tol", "k"
    default    its default value
    claims     the orders it claims
    refuses(case) -> sentence or None
    prepare(case, accuracy) -> Run    compile, allocate, factorise: untimed; only calling the Run is
    timed
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nsbench.case import Case
from nsbench.trajectory import Trajectory

Run = Callable[[], Trajectory]


@dataclass(frozen=True)
class Claims:
    """Orders in the accuracy parameter: h of fixed steps, 1/k of a penalty. None: no order is
    claimed.

    exact: the method claims the bound `exact` on the state error instead of an order
    (event-driven).
    rounding: how many times the rounding of one addition per step h can stand in the result: errors
    below it are no errors of the method.
    """

    state: float | None = None
    impulse: float | None = None
    exact: float | None = None
    rounding: float = 1.0


@dataclass(frozen=True)
class Expect:
    """What a method should show on a class of cases, and why; where no class applies its claims are
    expected.

    when: words of `Case.classes`, all of which the case has. state, impulse: an order, or a word:
    "exact" (rounding at every step, no order), "plateau", "diverges", "open" (no verdict can be
    expected), or the status that its runs should end with; None: nothing is said. The impulse's
    expectation holds for the reaction where that stands for it.
    why: the reason, with its source.
    """

    when: tuple[str, ...]
    state: float | str | None
    impulse: float | str | None
    why: str


class Solver(Protocol):
    """A method as the bench uses it.

    Optional: `expects`, a tuple of `Expect`, of which the first one that applies to a case counts;
    `checks`, a tuple of `nsbench.diagnostics.Check` of its own, applied to a run that ended well,
    before the general ones and outside of what is timed.
    """

    accuracy: str
    default: float
    claims: Claims

    def refuses(self, case: Case) -> str | None: ...

    def prepare(self, case: Case, accuracy: float) -> Run: ...


def check_positive(name: str, value) -> float:
    """`value` as a float; ValueError if it is not positive and finite."""
    try:
        v = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}; a number is needed") from None
    if not (np.isfinite(v) and v > 0):
        raise ValueError(f"{name} is {v!r}; positive and finite is needed")
    return v


@dataclass(frozen=True)
class Grid:
    """Recorded times and equal steps between them.

    t (K,): recorded times; substeps (K-1,): steps from one to the next; h: the largest step taken;
    aligned: the recorded times are the case's sample times (else the polygon is sampled, see
    `sample`).
    """

    t: np.ndarray
    substeps: np.ndarray
    h: float
    aligned: bool


def grid(t: np.ndarray, h: float, last: bool = False) -> Grid:
    """Steps of at most h for the sample times t. last: record the state before the last step to
    each sample too.

    A step that fits between samples divides every spacing; a longer one walks over them in steps of
    exactly h, the last one shortened, and samples are read off the polygon.
    """
    check_positive("h", h)
    spacing = np.diff(t)
    if h <= spacing.min() * (1 + 1e-9):
        n = np.maximum(1.0, np.ceil(spacing / h * (1 - 1e-9)))
        if not float(n.sum()) <= 2e9:
            raise ValueError(f"h = {h:g} needs {float(n.sum()):.3g} steps; at most 2e9 are taken")
        if h < 4 * np.spacing(np.abs(t).max()):
            raise ValueError(
                f"h = {h:g} is below the rounding of t = {np.abs(t).max():g}, where times are "
                f"{np.spacing(np.abs(t).max()):.2g} apart"
            )
        n = n.astype(np.int64)
        return (_with_last if last else Grid)(np.array(t), n, float((spacing / n).max()), not last)
    span = t[-1] - t[0]
    n = max(1, int(np.ceil(span / h * (1 - 1e-9))))
    nodes = np.append(t[0] + h * np.arange(n), t[-1])
    return Grid(nodes, np.ones(n, np.int64), float(min(h, span)), False)


def _with_last(t, n, h, aligned):
    """The same steps with the time before the last one of each interval among the recorded
    times."""
    several = n > 1
    before = (t[1:] - np.diff(t) / n)[several]
    place = np.flatnonzero(several) + 1
    return Grid(
        np.insert(t, place, before),
        np.insert(np.where(several, 1, n), np.flatnonzero(several), n[several] - 1),
        h,
        aligned,
    )


def last_steps(t: np.ndarray, g: Grid, impulse: np.ndarray) -> dict:
    """lam and lam_h of a Trajectory from the impulses (K, m) at the recorded times of `grid(t, h,
    last=True)`; {} where steps are longer than the sample spacing."""
    at = np.searchsorted(g.t, t)
    if g.aligned or not (
        at[-1] < len(g.t) and np.array_equal(g.t[at], t) and np.all(g.substeps[at[1:] - 1] == 1)
    ):
        return {}
    h = np.append(np.nan, g.t[at[1:]] - g.t[at[1:] - 1])
    lam = np.full((len(t), impulse.shape[1]), np.nan)
    lam[1:] = (impulse[at[1:]] - impulse[at[1:] - 1]) / h[1:, None]
    return {"lam": lam, "lam_h": h}


def sample(t: np.ndarray, nodes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The polygon through (nodes, values) at the times t; values (K, n)."""
    i = np.clip(np.searchsorted(nodes, t, side="right") - 1, 0, len(nodes) - 2)
    w = ((t - nodes[i]) / (nodes[i + 1] - nodes[i]))[:, None]
    return np.where(
        w == 0.0,
        values[i],
        np.where(w == 1.0, values[i + 1], (1.0 - w) * values[i] + w * values[i + 1]),
    )
