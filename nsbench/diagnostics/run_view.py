"""A finished run for its checks: known states, resolution in time, switches and violations there.

The known states are the samples and, of Filippov systems, the states that the method stored between
them (`Trajectory.between`). Between known states the path is taken as a polygon. Switches, their
one-sided rates, sliding intervals and constraint violations are computed when a check first needs
them, and once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.dynamics.filippov.switch_rates import STEP, one_sided_rates, sliding_intervals
from nsbench.dynamics.filippov.vector_field import FilippovVectorField
from nsbench.trajectory import Resolution, Trajectory

# of the time of a run: between states nearer to one another, weights are rounding
CLOSE = 1e-6
HALVINGS = 50  # of an interval of time: more than the bits of a time
RULES_BY_LABEL = {"start": "explicit", "end": "implicit"}  # of a Trajectory without `resolution`


class RunView:
    """A run of a case and all that its checks share.

    case, trajectory: as they are; trajectory holds the samples alone.
    resolution: fixed step, layer and tolerances of the method.
    t (K,), x (K, n), impulse (K, m): samples and the states stored between them, in order of time.
    """

    def __init__(self, case: Case, trajectory: Trajectory):
        self.case = case
        self.trajectory = trajectory
        self.resolution = trajectory.resolution or infer_resolution(trajectory)
        self.t, self.x, self.impulse = merge_states_between(trajectory)
        self._rates: dict[tuple[int, int], tuple[float, float]] = {}

    @property
    def explicit_step(self) -> float:
        """Length of the steps of an explicit fixed-step method; 0.0 of all other methods."""
        return self.resolution.step if self.resolution.rule == "explicit" else 0.0

    @property
    def difference_step(self) -> float:
        """The time difference from which rates of switches are taken."""
        return STEP * (self.t[-1] - self.t[0])

    @cached_property
    def state(self) -> Callable:
        """Time, or times (k,), -> the state (n,), or (n, k), on the polygon of the known states."""
        return polygon(self.t, self.x)

    @cached_property
    def switch(self) -> Callable:
        """The switch functions (t, x) -> (d,), in numpy."""
        return as_numpy(self.case.problem.switch)

    @cached_property
    def field(self) -> Callable:
        """The field (t, x, s) -> (n,) of a Filippov system, in numpy."""
        return as_numpy(self.case.problem.field)

    @cached_property
    def vector_field(self) -> FilippovVectorField:
        """The Filippov system with exact gradients of its switches."""
        return FilippovVectorField(self.case.problem, float(self.case.t[0]), self.x[0].copy())

    @cached_property
    def switches(self) -> np.ndarray:
        """(K, d) values of the switch functions at the known states."""
        return np.array([self.switch(t, x.copy()) for t, x in zip(self.t, self.x, strict=True)])

    @cached_property
    def slides(self) -> np.ndarray:
        """(K - 1, d) bool: the run slides on the surface between two known states."""
        d = self.switches.shape[1]
        return sliding_intervals(self.t, self.trajectory.contacts, self.impulse, d)[1]

    @cached_property
    def violations(self) -> np.ndarray:
        """(samples,) the largest violation of a constraint at every sample, negative if none is."""
        scene = scene_of(self.case)
        traj = self.trajectory
        return np.array(
            [scene.max_violation(float(t), x) for t, x in zip(traj.t, traj.x, strict=True)]
        )

    def one_sided_rates(self, k: int, i: int) -> tuple[float, float]:
        """Return dc_i/dt at the known state k in the fields of the positive and negative side."""
        key = int(k), int(i)
        if key not in self._rates:
            self._rates[key] = self.rates_at(self.t[k], self.x[k], i)
        return self._rates[key]

    def rates_at(self, t: float, x: np.ndarray, i: int) -> tuple[float, float]:
        """Return dc_i/dt at (t, x) in the fields of the positive and negative side."""
        return one_sided_rates(self.switch, self.field, t, x, i, self.difference_step)


def infer_resolution(traj: Trajectory) -> Resolution:
    """Infer the resolution of a method that does not state it.

    The step is stats["h"]; a multiplier that belongs to the start or the end of its step is that of
    an explicit or an implicit method.
    """
    return Resolution(
        step=float(traj.stats.get("h") or 0.0), rule=RULES_BY_LABEL.get(traj.lam_time, "")
    )


def merge_states_between(traj: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (K,), states (K, n) and impulses (K, m) of the samples and of states between.

    Stored states that are nearer than CLOSE to a sample, or to the state before, are left out.
    """
    if traj.between is None or not len(traj.between[0]):
        return traj.t, traj.x, traj.impulse
    t, x, impulse = traj.between
    span = CLOSE * (traj.t[-1] - traj.t[0])
    later = np.minimum(np.searchsorted(traj.t, t), len(traj.t) - 1)
    away = np.minimum(np.abs(t - traj.t[later]), np.abs(t - traj.t[later - 1])) > span
    away[1:] &= np.diff(t) > span
    t, x, impulse = (
        np.append(a, b[away], axis=0)
        for a, b in zip((traj.t, traj.x, traj.impulse), (t, x, impulse), strict=True)
    )
    order = np.argsort(t)
    return t[order], x[order], impulse[order]


def polygon(t: np.ndarray, X: np.ndarray) -> Callable:
    """Return the map from a time, or times (k,), to the state (n,), or (n, k), of a polygon.

    t (K,), X (K, n): the vertices.
    """
    return lambda at: np.array([np.interp(at, t, column) for column in X.T])


def thin_samples(t: np.ndarray, span: float) -> np.ndarray:
    """Return indices into t (K,) of samples at least `span` apart, as far as the run is that long.

    The first and the last sample are among them.
    """
    chosen = [0]
    for k in range(1, len(t) - 1):
        if t[k] - t[chosen[-1]] >= span and t[-1] - t[k] >= span:
            chosen.append(k)
    return np.array([*chosen, len(t) - 1])


def zero_between(f: Callable[[float], float], low: float, high: float) -> float:
    """Bisect for a zero of f between two times at which it has different signs.

    Only the sign of f is used; NaN counts as not positive.
    """
    positive = f(low) > 0.0
    for _ in range(HALVINGS):
        mid = 0.5 * (low + high)
        if (f(mid) > 0.0) == positive:
            low = mid
        else:
            high = mid
    return 0.5 * (low + high)
