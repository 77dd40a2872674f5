"""Stability of one step: by how much it pulls two states apart.

    |Phi_h x - Phi_h y| <= (1 + C L h) |x - y|,

Phi_h one step of a method from time t, L the Lipschitz constant of the drift, of its modes where
there are several. On a convex set of states the smallest C belongs to the largest norm of the
derivative, C = (|D Phi_h| - 1) / (L h). From below: D Phi_h by differences at feasible states
along a run, its largest singular value, the norm climbed over feasible states nearby. What counts
is the growth of the pair of states in the direction found.

From above, for PBD, on the balls of radius r around the states of the run, which hold all states of
the climb. The free step pulls apart by at most 1 + L h. Projections onto half-spaces and into balls
(links) do not pull apart; one that parts two discs to the distance d stretches their tangential
distance by d / (d - overlap). Projections that share no disc act side by side, so that a sweep
stretches by at most the product S over its layers of such projections of the largest stretch in
each. Within the ball the distance of a pair differs from that at its centre by at most sqrt(2)
S (1 + L h) r, S that of the layers before, which bounds every overlap in turn. L is taken at the
states looked at (it is the same everywhere for affine drifts); all is computed in doubles.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.problem import Complementarity, Distance, Filippov
from nsbench.solvers.scaled_run import ScaledRun
from nsbench.studies.chain.large_steps import all_pairs, project_pair
from nsbench.studies.fan.windermere import project, without_answers
from nsbench.studies.runs.finished_run import USABLE, finish

DIFFERENCE = 1e-6  # of the size of the state: the distance of the two states of a pair
ORDERS = {"pbd": 1, "pbd[order=reverse]": -1}  # of the sweep, for which a bound is computed
FARTHEST = 0.5  # of the way of the fastest coordinate in a free step: how far a climb goes


@dataclass(frozen=True)
class StepGrowth:
    """The largest growth found: of the pair, its bound at the same states (None: none is known).

    lipschitz: of the drift, the largest at these states. states: how many were looked at.
    """

    h: float
    growth: float
    bound: float | None
    lipschitz: float
    states: int

    def constant(self, growth: float | None) -> float | None:
        """Return C of a growth; None without one, or where the drift is the same everywhere."""
        if growth is None or self.lipschitz == 0.0:
            return None
        return (growth - 1.0) / (self.lipschitz * self.h)


def measure_growth(case: Case, method: str, h: float, states: int, climbs: int) -> StepGrowth:
    """Find the largest growth of one step at `states` times of a run, then by `climbs` moves.

    Raises ArithmeticError where the run or a step does not end well.
    """
    rng = np.random.default_rng(0)
    run = finish(case, method, h, USABLE)
    chosen = np.linspace(0, len(run.t) - 2, states).round().astype(int)
    looked = [_look(case, method, h, run.t[k], run.x[k]) for k in dict.fromkeys(chosen.tolist())]
    lipschitz = max(a.lipschitz for a in looked)
    bounds = [_sweep_bound(case, method, h, a, lipschitz) for a in looked]
    best = centre = max(looked, key=lambda a: a.growth)
    for _ in range(climbs):
        away = best.x - centre.x + _reach(case, h, centre) * _direction(rng, case.n) * rng.random()
        away *= min(1.0, _reach(case, h, centre) / max(float(np.linalg.norm(away)), DIFFERENCE))
        looked.append(_look(case, method, h, centre.t, centre.x + away))
        best = max(best, looked[-1], key=lambda a: a.growth)
    bound = None if None in bounds else max(bounds)
    return StepGrowth(h, best.growth, bound, lipschitz, len(looked))


def _direction(rng, n):
    v = rng.standard_normal(n)
    return v / np.linalg.norm(v)


def _reach(case, h, a):
    """How far a climb goes from a state before it is made feasible, which moves it no farther."""
    return FARTHEST * h * max(float(np.abs(f(a.t, a.x)).max()) for f in _drifts(case))


@dataclass(frozen=True)
class _Looked:
    """A feasible state x at t, with the growth of a pair around it and L of the drift."""

    t: float
    x: np.ndarray
    growth: float
    lipschitz: float


def _look(case, method, h, t, x):
    """Look at the feasible state nearest to x."""
    if isinstance(case.problem, Complementarity):
        x = project(case, x, t)
    away = DIFFERENCE * max(1.0, float(np.abs(x).max()))

    def step(y: np.ndarray) -> np.ndarray:
        return _step(case, method, h, t, y)

    # singular values lie within O(h) of each other, for which a power iteration is too slow
    direction = np.linalg.svd(_derivative(step, x, away))[2][0]
    pair = step(x + away * direction) - step(x - away * direction)
    growth = float(np.linalg.norm(pair) / (2.0 * away))
    return _Looked(t, x, growth, _lipschitz(case, t, x, away))


def _step(case, method, h, t, x):
    """Phi_h: one step of the method from x at t, violated or not."""
    one = without_answers(case, np.array([t, t + h])).replace(x0=x, start="keep")
    run = ScaledRun(solvers.get(method), one, h)
    found = run.to_user_units(run())
    if len(found.x) != 2:
        raise ArithmeticError(f"{method} on {case.key}: a step from t = {t:g} fails")
    return found.x[-1]


def _derivative(f, x, away):
    """The derivative (m, n) of f at x, by differences on one side."""
    start = f(x)
    return np.stack([(f(x + away * e) - start) / away for e in np.eye(x.size)], axis=1)


def _drifts(case):
    """The drifts f(t, x) of the case, one for each sign tuple."""
    problem = case.problem
    if not isinstance(problem, Filippov):
        return [problem.drift(np)]
    d = problem.switch(np)(float(case.t[0]), case.x0).size
    field = problem.field(np)
    return [
        lambda t, x, s=np.array(signs): field(t, x, s) for signs in product((1.0, -1.0), repeat=d)
    ]


def _lipschitz(case, t, x, away):
    """The largest norm of the derivative of the drifts at x, to the rounding of differences."""
    norms = [
        float(np.linalg.norm(_derivative(lambda y, f=f: f(t, y), x, away), 2))
        for f in _drifts(case)
    ]
    return max(v if v > DIFFERENCE else 0.0 for v in norms)


def _sweep_bound(case, method, h, a, lipschitz):
    """The bound of the growth in the ball around a state of the run; None where none is known."""
    order = ORDERS.get(method)
    hard = [c for c in getattr(case.problem, "constraints", ()) if isinstance(c, Distance)]
    hard = [c for c in hard if c.sign > 0]
    if order is None or not isinstance(case.problem, Complementarity):
        return None
    free = 1.0 + lipschitz * h
    if not hard:
        return free
    if len(case.problem.constraints) > 1 or not _is_equal_discs(hard[0]):
        return None
    y = (a.x + h * case.problem.drift(np)(a.t, a.x)).reshape(-1, 2)
    radius = free * 2.0 * _reach(case, h, a)
    return free * _stretch_of_sweep(y, all_pairs(len(y))[::order], float(hard[0].d), radius)


def _is_equal_discs(c):
    """Are the particles equal free discs in the plane, each pair of them a constraint?"""
    return c.dim == 2 and c.pairs is None and c.anchors is None and np.ndim(c.d) == 0


def _stretch_of_sweep(centres, pairs, diameter, radius):
    """The product over layers, of projections without a common disc, of the largest stretch.

    centres (n, 2): moved by the sweep. radius: of the ball of states around them; inf where two
    centres may meet in it.
    """
    last = np.zeros(len(centres), dtype=int)  # layer of the last projection of each disc
    layers = [1.0]
    for i, j in pairs:
        distance = float(np.linalg.norm(centres[j] - centres[i]))
        nearest = distance - np.sqrt(2.0) * float(np.prod(layers)) * radius
        if nearest >= diameter:
            continue
        if nearest <= 0.0:
            return float("inf")
        project_pair(centres, i, j, diameter)
        last[i] = last[j] = layer = max(last[i], last[j]) + 1
        if layer == len(layers):
            layers.append(1.0)
        layers[layer] = max(layers[layer], diameter / nearest)
    return float(np.prod(layers))
