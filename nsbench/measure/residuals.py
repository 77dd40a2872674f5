"""Residuals that need no reference: feasibility, sign, complementarity, and the equation itself.

All are in the units of the case and computed from samples and impulses alone. Interval means of the
multipliers are impulse increments over the sample spacing D.

feasibility      max over samples of max_k (-g_k)^+; LCS: of the interval means of -w, and at
                 samples in rows without lam; Filippov, hybrid: none (NaN). A method that keeps
                 w >= 0 at the ends of its steps alone (theta = 1) shows O(h) there, less what the
                 quadrature may be wrong by
sign             least interval mean of a multiplier; Filippov: least of theta and 1 - theta;
                 hybrid: least part of an interval that is spent in a mode
complementarity  largest over intervals of (gap at both ends)^+ x mean multiplier; Filippov:
                 c^+ (1 - theta) and (-c)^+ theta; LCS: mean w x mean lam where nothing switches.
                 A contact that acts and lets go between two samples is seen with an error of
                 O(D^2)
residual         largest over intervals of (|x_{k+1} - x_k - int f - (R_{k+1} - R_k)| - q)^+ / D, a
                 velocity, and of the same for R_{k+1} - R_k = sum of impulse x gradient; int f by
                 quadrature over the samples, whose error is estimated by q (see quadrature; order
                 six, two at kinks of f, one at its jumps). Of the order of the method, down to
                 O(D^2) in intervals that hold several events, which samples D apart cannot tell
                 from a defect.
                 Filippov: distance of (x_{k+1} - x_k) / D to the convex hull of the fields' means,
                 over the modes that the weights theta allow (between 0 and 1: both sides); a mean
                 of products is not the product of means, which is allowed for by a quarter of the
                 product of both ranges, O(D^2) for smooth theta.
                 Hybrid: of the equation of the mode, in intervals without a transition

With two samples, how an integrand moves between them is not known: what needs a quadrature (the
residual; feasibility and complementarity of an LCS) is NaN.

Which residuals there are, the table of columns says (group "residual" of nsbench.columns). A new
one is an entry there, and a value under its name in what `_measured` puts into `found`; where
nothing is computed under a name, the residual is NaN.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.columns import names
from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.filippov.convex_hull import distance_to_hull
from nsbench.measure.context import MeasureContext, changes, near_of
from nsbench.measure.quadrature import around, integrals, kinked_intervals
from nsbench.problem import LCS, Filippov, Hybrid
from nsbench.reference import right_hand_side, spread
from nsbench.trajectory import Trajectory

OPEN = 1e-6  # of the largest w or multiplier: below, it may be none, and an error
# residuals that two samples do not determine: of an LCS, and of all other problems
BY_QUADRATURE_OF_LCS = ("feasibility", "complementarity", "residual")
BY_QUADRATURE = ("residual",)


def no_residuals() -> dict[str, float]:
    """Return NaN for every residual of the table of columns."""
    return dict.fromkeys(names("residual"), float("nan"))


def residuals(frame: MeasureContext, traj: Trajectory) -> dict:
    """Measure all residuals over the samples before the first that is not finite.

    NaN where there are fewer than two.
    """
    return _measured(frame, traj)[0]


def interval_residuals(frame: MeasureContext, traj: Trajectory) -> np.ndarray:
    """Measure the residual of each interval (k - 1,), a velocity; NaN where it has none.

    `residual` is the largest of them.
    """
    return _measured(frame, traj)[1]


def _measured(frame: MeasureContext, traj: Trajectory) -> tuple[dict, np.ndarray]:
    """Measure all residuals; return them by name, and the residual of each interval (k - 1,)."""
    good = np.all(np.isfinite(traj.x), axis=1) & np.all(np.isfinite(traj.impulse), axis=1)
    good &= np.all(np.isfinite(traj.reaction), axis=1)
    k = int(np.argmin(good)) if not good.all() else len(good)
    out = no_residuals()
    each = np.full(max(len(good) - 1, 0), np.nan)
    if k < 2:
        return out, each
    t = traj.t[:k]
    x = traj.x[:k].copy()
    impulse = traj.impulse[:k]
    reaction = traj.reaction[:k]
    # a drift that writes into the state it is given is found out here, if not before
    x.flags.writeable = False
    events = [e.t for e in traj.events]
    if frame.ref is not None:
        events += [e.t for e in frame.ref.events or ()]
    kinked = kinked_intervals(
        t, changes(frame.case.problem, t, impulse) if k > 2 else np.zeros(k - 2, bool), events
    )
    is_lcs = isinstance(frame.case.problem, LCS)
    with np.errstate(all="ignore"):
        if isinstance(frame.case.problem, Filippov):
            found, off = _inclusion(frame.case, traj.contacts, t, x, impulse, kinked)
            found["residual"] = off.max(initial=0.0)
        elif isinstance(frame.case.problem, Hybrid):
            found, off = _modes(frame.case.problem, t, x, impulse, kinked)
            found["residual"] = np.nanmax(off, initial=0.0)
        else:
            lam = np.diff(impulse, axis=0) / np.diff(t)[:, None]
            args = frame, traj.contacts, t, x, impulse, reaction, lam
            found, mismatch = _lcs(*args, kinked) if is_lcs else _gaps(*args)
            equation = _equation(frame, t, x, impulse, reaction, kinked, traj.contacts)
            found["sign"] = lam.min(initial=0.0)
            found["residual"] = max(
                float(equation.max(initial=0.0)), float(mismatch.max(initial=0.0))
            )
            off = np.maximum(equation, mismatch)
    out |= {name: float(value) for name, value in found.items() if name in out}
    if k == 2:
        by_quadrature = BY_QUADRATURE_OF_LCS if is_lcs else BY_QUADRATURE
        out |= {name: float("nan") for name in by_quadrature if name in out}
    else:
        each[: k - 1] = off
    return out, each


def _equation(frame, t, x, impulse, reaction, kinked, contacts) -> np.ndarray:
    """Measure the residual of the differential equation in each interval (k - 1,)."""
    f = right_hand_side(frame.case.problem)
    F = np.array([f(a, b) for a, b in zip(t, x, strict=True)])
    value, doubt = integrals(t, F, kinked)
    R = reaction if reaction.shape[1] else _lcs_push(frame.case.problem, contacts, impulse)
    rho = np.abs(np.diff(x, axis=0) - value - np.diff(R, axis=0))
    return (np.maximum(rho - doubt, 0.0) / np.diff(t)[:, None]).max(axis=1, initial=0.0)


def _gaps(frame, contacts, t, x, impulse, reaction, lam):
    """Measure feasibility, complementarity, and how far the reaction is from impulse x gradient.

    Returns the first two by name, and the last by interval (k - 1,), per unit of time. The gradient
    of an interval is the mean of both ends. What that may be wrong by is bounded by half the
    largest change of the gradient over this interval and the two on each side, times the impulse.
    """
    scene = frame.scene
    worst = max(scene.max_violation(a, b) for a, b in zip(t, x, strict=True))
    if not contacts:
        found = {"feasibility": worst, "complementarity": 0.0}
        return found, np.abs(np.diff(reaction, axis=0)).max(axis=1, initial=0.0)
    near = near_of(scene, contacts)
    places = scene.layout(near)
    complementary = 0.0
    mismatch = np.zeros(len(t) - 1)
    gaps = [scene.gaps(a, b, near, places) for a, b in zip(t, x, strict=True)]
    gradients = _Gradients(scene, near, places, t, x)
    for k, d in enumerate(np.diff(impulse, axis=0)):
        both = np.maximum(np.minimum(gaps[k], gaps[k + 1]), 0.0)
        complementary = max(complementary, float((both * np.maximum(lam[k], 0.0)).max(initial=0.0)))
        rho = np.abs(reaction[k + 1] - reaction[k] - gradients.push(k, d)) - gradients.doubt(k, d)
        mismatch[k] = max(0.0, float(rho.max(initial=0.0)) / (t[k + 1] - t[k]))
    return {"feasibility": worst, "complementarity": complementary}, mismatch


class _Gradients:
    """Gradients of contacts at the samples, as entries of one sparse pattern that all share.

    Only the samples around the interval requested last are stored: these are the largest arrays
    here.
    """

    def __init__(self, scene, near, places, t, x):
        self.scene = scene
        self.near = near
        self.places = places
        self.t = t
        self.x = x
        self.values: dict = {}
        self.steps: dict = {}
        row, col, _ = scene.gradient_entries(float(t[0]), x[0], near)
        places, self.place = np.unique(row * scene.n + col, return_inverse=True)
        self.row = places // scene.n
        self.col = places % scene.n

    def _around(self, k: int) -> range:
        """Return the samples of interval k and of the two intervals on each side.

        Entries of older samples are dropped.
        """
        used = range(max(k - 2, 0), min(k + 4, len(self.t)))
        self.values = {j: self.values[j] if j in self.values else self._entries(j) for j in used}
        self.steps = {
            j: self.steps[j] if j in self.steps else np.abs(self.values[j + 1] - self.values[j])
            for j in used[:-1]
        }
        return used

    def _entries(self, j: int) -> np.ndarray:
        """Return the entries of the gradients at sample j."""
        values = self.scene.gradient_values(float(self.t[j]), self.x[j], self.near, self.places)
        return np.bincount(self.place, values, len(self.row))

    def push(self, k: int, d: np.ndarray) -> np.ndarray:
        """Return (n,) the mean gradient of interval k times the impulses d."""
        self._around(k)
        mean = 0.5 * (self.values[k] + self.values[k + 1])
        return np.bincount(self.col, mean * d[self.row], self.scene.n)

    def doubt(self, k: int, d: np.ndarray) -> np.ndarray:
        """Return (n,) half the largest change of the gradient around interval k, times |d|."""
        most = np.max([self.steps[j] for j in self._around(k)[:-1]], axis=0)
        return np.bincount(self.col, 0.5 * most * np.abs(d)[self.row], self.scene.n)


def _lcs_push(problem, contacts, impulse):
    """Return (k, n) B times the impulse."""
    return (
        spread(problem, contacts, impulse, {(0, i): i for i in range(problem.B.shape[1])})
        @ problem.B.T
    )


def _switched(p, v, lam):
    """Mark the intervals (k - 1,) in which a lam acts that is 0 at one of both ends.

    There w > 0, whatever lam >= 0 is.
    """
    apart = (v > OPEN * np.abs(v).max(axis=0, initial=0.0)) & (p.D >= 0.0).all(axis=1)
    acts = lam > OPEN * np.abs(lam).max(initial=0.0)
    return ((apart[1:] ^ apart[:-1]) & acts).any(axis=1)


def _lcs(frame, contacts, t, x, impulse, reaction, lam, kinked):
    """Measure feasibility, complementarity and reaction of a linear complementarity system.

    Returns as _gaps. w has interval means by the quadrature of C x + q, less its error estimate;
    rows without lam count at samples. Complementarity is a product of means, so it is computed
    where nothing switches.
    """
    p = frame.case.problem
    q = as_numpy(p.q) if p.q else lambda s: 0.0
    v = np.array([p.C @ b + q(a) for a, b in zip(t, x, strict=True)])
    lam = spread(p, contacts, lam, {(0, i): i for i in range(p.B.shape[1])})
    kinked = kinked | _switched(p, v, lam)
    value, doubt = (a / np.diff(t)[:, None] for a in integrals(t, v, kinked))
    w = value + lam @ p.D.T
    both = np.maximum(w - doubt, 0.0) * np.maximum(lam, 0.0)
    complementary = float(both[~kinked].max(initial=0.0))
    feasible = max(
        float((-w - doubt).max(initial=0.0)), float(-v[:, ~p.D.any(axis=1)].min(initial=0.0)), 0.0
    )
    mismatch = np.zeros(len(t) - 1)
    if reaction.shape[1]:
        off = np.diff(reaction - _lcs_push(p, contacts, impulse), axis=0)
        mismatch = (np.abs(off) / np.diff(t)[:, None]).max(axis=1, initial=0.0)
    return {"feasibility": feasible, "complementarity": complementary}, mismatch


def _inclusion(case, contacts, t, x, impulse, kinked):
    """Measure how far a Filippov run is from its differential inclusion.

    Returns by name the least weight (sign) and complementarity, and by interval (k - 1,) the
    distance of the mean velocity to the convex hull of the mean fields of the acting modes, less
    the error estimates of the quadrature; NaN where no acting mode has a finite mean.
    """
    p = case.problem
    switch = as_numpy(p.switch)
    field = as_numpy(p.field)
    c = np.array([switch(a, b) for a, b in zip(t, x, strict=True)])
    d = c.shape[1]
    theta = (
        np.diff(spread(p, contacts, impulse, {(0, i): i for i in range(d)}), axis=0)
        / np.diff(t)[:, None]
    )
    above = np.maximum(np.minimum(c[1:], c[:-1]), 0.0)
    below = np.maximum(np.minimum(-c[1:], -c[:-1]), 0.0)
    complementary = max(
        float((above * (1 - theta)).max(initial=0.0)), float((below * theta).max(initial=0.0))
    )
    found = {
        "sign": float(np.minimum(theta, 1 - theta).min()),
        "complementarity": complementary,
    }
    means = {}
    doubts = {}
    F = {}
    for mode in product((1.0, -1.0), repeat=d):
        F[mode] = np.array([field(a, b, np.array(mode)) for a, b in zip(t, x, strict=True)])
        value, doubt = integrals(t, F[mode], kinked)
        means[mode], doubts[mode] = (v / np.diff(t)[:, None] for v in (value, doubt))
    mixed = _mixing(theta, F)
    off = np.zeros(len(t) - 1)
    for k, v in enumerate(np.diff(x, axis=0) / np.diff(t)[:, None]):
        # weights that miss 0 or 1 by rounding belong to one mode alone
        sides = [
            ((1.0,) if w > 1 - 1e-9 else (-1.0,) if w < 1e-9 else (1.0, -1.0)) for w in theta[k]
        ]
        modes = [m for m in product(*sides) if np.all(np.isfinite(means[m][k]))]
        if not modes:
            return found, np.full(len(off), np.nan)
        slack = max(float(np.linalg.norm(doubts[m][k])) for m in modes) + (
            mixed[k] if len(modes) > 1 else 0.0
        )
        off[k] = max(0.0, distance_to_hull(v, np.array([means[m][k] for m in modes])) - slack)
    return found, off


def _modes(problem, t, x, impulse, kinked):
    """Measure how far a run of a hybrid system is from the equation of its mode, by interval.

    Returns by name the least part of an interval that is spent in a mode (sign), and the defects
    (k - 1,), NaN in intervals with a transition.
    """
    spent = np.diff(impulse, axis=0) / np.diff(t)[:, None]
    mode = spent.argmax(axis=1) if spent.shape[1] else np.zeros(len(t) - 1, int)
    off = np.full(len(t) - 1, np.nan)
    for i, drift in enumerate(problem.modes.values()):
        own = (mode == i) & ~kinked
        if own.any():
            f = as_numpy(drift)
            F = np.array([f(a, b) for a, b in zip(t, x, strict=True)])
            # samples in another mode, or after a jump, are no nodes of this one's quadrature
            value, doubt = integrals(t, F, ~own)
            rho = np.maximum(np.abs(np.diff(x, axis=0) - value) - doubt, 0.0) / np.diff(t)[:, None]
            off[own] = rho.max(axis=1)[own]
    return {"sign": float(np.min(spent, initial=0.0))}, off


def _mixing(theta, F) -> np.ndarray:
    """Bound |mean of theta x field - mean theta x mean field| by interval, (k - 1,).

    A quarter of the product of both ranges (Gruess), the range of theta taken from the neighbouring
    means, that of the fields' difference from the samples.
    """
    out = np.zeros(len(theta))
    swing = around(np.abs(np.diff(theta, axis=0, append=theta[-1:])))
    for i in range(theta.shape[1]):
        apart = [F[m] - F[(*m[:i], -1.0, *m[i + 1 :])] for m in F if m[i] > 0]
        moved = np.max([np.linalg.norm(np.diff(a, axis=0), axis=1) for a in apart], axis=0)
        out += 0.25 * swing[:, i] * around(moved)
    return out
