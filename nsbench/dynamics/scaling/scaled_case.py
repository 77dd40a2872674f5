"""Convert a case into its own units, and the runs of that case back into the user's.

    tau = (t - t0) / T,    y_i = x_i / S_i

With dt = T dtau a field f becomes (T / S) f(t0 + T tau, S y). Of gradient systems S is one length
L: a gap g becomes g / L, and a multiplier T / L times itself. Of linear complementarity systems w
and lambda have units of their own. All units are powers of two: scaling rounds nothing, and one
system in units that differ by powers of two is one system here, to the last bit.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import Scale, in_units
from nsbench.columns import by_name
from nsbench.compilation.factories import Scaling
from nsbench.dynamics.scaling.estimate import case_scale, power_of_two, switch_sizes
from nsbench.problem import LCS, Affine, Complementarity, Distance, Filippov, Hybrid, Smooth
from nsbench.trajectory import Event, Resolution, Trajectory


@dataclass(frozen=True, eq=False)
class ScaledCase:
    """A case in its own units.

    case: in these units. origin: the time at which tau = 0. time: T; state (n,): S. multiplier,
    gap: a multiplier and a gap, or switch, of size one, in the units of the user.
    """

    case: Case
    origin: float
    time: float
    state: np.ndarray
    multiplier: float
    gap: float

    @property
    def impulse(self) -> float:
        """Return the impulse of size one, in the units of the user."""
        return self.multiplier * self.time

    @functools.cached_property
    def length(self) -> float:
        """Return the largest size of a coordinate, in the units of the user."""
        return float(np.max(self.state))

    def accuracy(self, name: str, value: float) -> float:
        """Return the value of an accuracy parameter (h, tol or k) in the units of the case.

        A penalty's multiplier is k times a gap; its weight of a side, k times a switch.
        """
        stiffness = self.gap / self.multiplier
        return {"h": value / self.time, "k": value * stiffness}.get(name, value)

    def in_user_units(self):
        """Write sentences that are made within, of times and sizes, in the units of the user."""
        return in_units(self.origin, self.time, self.length)

    def scaled(self, traj: Trajectory) -> Trajectory:
        """Return a trajectory of the user's case in the units of the scaled one."""
        return self._converted(traj, self._to_own, 1.0 / self.time, 1.0 / self.state)

    def restored(self, traj: Trajectory, times: np.ndarray) -> Trajectory:
        """Return a trajectory of the scaled case in the user's units; times (k,): the samples."""
        exact = times if len(traj.t) == len(times) else None
        return self._converted(traj, self._to_user, self.time, self.state, exact)

    def _to_own(self, t):
        return (t - self.origin) / self.time

    def _to_user(self, t):
        return self.origin + self.time * t

    def _converted(self, traj, instant, time, state, times=None):
        up = time == self.time
        multiplier = self.multiplier if up else 1.0 / self.multiplier
        impulse = self.impulse if up else 1.0 / self.impulse
        between = traj.between
        resolution = traj.resolution
        return dataclasses.replace(
            traj,
            t=instant(traj.t) if times is None else times,
            x=traj.x * state,
            impulse=traj.impulse * impulse,
            reaction=traj.reaction * state if traj.reaction.size else traj.reaction,
            events=tuple(Event(float(instant(e.t)), e.kind, e.contact) for e in traj.events),
            stats=_converted_stats(traj.stats, instant, time, float(state.max())),
            lam=None if traj.lam is None else traj.lam * multiplier,
            lam_h=None if traj.lam_h is None else traj.lam_h * time,
            between=between and (instant(between[0]), between[1] * state, between[2] * impulse),
            resolution=resolution and _converted_resolution(resolution, time),
        )


INSTANTS = ("accumulation",)  # columns of times that are no lengths of time


def _converted_resolution(resolution: Resolution, time: float) -> Resolution:
    """Return what a method resolves with its times in other units."""
    if resolution.step == resolution.stiffness == 0.0:
        return resolution
    return dataclasses.replace(
        resolution, step=resolution.step * time, stiffness=resolution.stiffness / time
    )


def _converted_stats(stats: dict, instant, time: float, length: float) -> dict:
    """Return the counted work of a run with its times and lengths in other units."""
    known = by_name()
    factor = {"time": time, "state": length}
    out = dict(stats)
    for name, value in stats.items():
        if name in INSTANTS:
            out[name] = float(instant(value))
        elif name in known and known[name].unit in factor and isinstance(value, float):
            out[name] = value * factor[known[name].unit]
    return out


@functools.lru_cache(maxsize=64)
def scaled_case(case: Case, scale: Scale | None = None) -> ScaledCase:
    """Return the case in its own units; scale: other ones. Cached by the case."""
    scale = scale or case_scale(case)
    T = power_of_two(scale.time)
    S = power_of_two(np.broadcast_to(scale.state, case.x0.shape))
    t0 = float(case.t[0])
    p = case.problem
    if isinstance(p, Complementarity):
        S = np.full(case.n, S.max())
        problem = _gradient_system(p, t0, T, float(S[0]))
        multiplier = S[0] / T
        gap = S[0]
    elif isinstance(p, LCS):
        problem, multiplier, gap = _lcs(p, t0, T, S)
    else:
        problem = (_hybrid if isinstance(p, Hybrid) else _filippov)(p, t0, T, S)
        multiplier = gap = 1.0
    out = ScaledCase(case, t0, T, S, float(multiplier), float(gap))
    own = case.replace(
        problem=problem,
        x0=case.x0 / S,
        t=(case.t - t0) / T,
        exact=_closed_form(case.exact, t0, T, S),
        exact_impulse=_closed_form(case.exact_impulse, t0, T, out.impulse),
        exact_events=None,
        distance=None,
        radius=None,
        scale=Scale(1.0, np.ones(case.n)),
    )
    return dataclasses.replace(out, case=own)


@functools.lru_cache(maxsize=64)
def with_own_switches(case: Case) -> Case:
    """Return a Filippov case in its own units with each switch in a unit of its own; others as is.

    A method runs on it, so that no constant of it depends on the unit of a switch; checks, in which
    a layer has the user's, do not.
    """
    if not isinstance(case.problem, Filippov):
        return case
    p = case.problem
    unit = 1.0 / power_of_two(switch_sizes(case))
    switch = _function(p.switch, 0.0, 1.0, np.ones(1), unit)
    return case.replace(problem=Filippov(None, switch, p.field, p.d))


def _closed_form(exact, t0, T, unit):
    return exact and (lambda t: np.asarray(exact(t0 + T * np.asarray(t))) / unit)


def _signed(factory, t0, T, S):
    """Return the factory of (T / S) f(t0 + T tau, S y, s) for the field f of a Filippov system."""

    def make(xp):
        f = factory(xp)
        size = S + 0.0
        rate = T / S
        if xp.__name__ != "numpy":
            size = xp.asarray(size)
            rate = xp.asarray(rate)

        def scaled(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
            return rate * xp.asarray(f(t0 + T * t, size * x, s))

        if xp.__name__ == "numpy":
            scaled.scaling = Scaling(f, t0, T, size, rate)
        return scaled

    return make


def _composed(outer: Scaling) -> Scaling:
    """Return one scaling for two, where the outer one leaves time and state as they are."""
    inner = getattr(outer.function, "scaling", None)
    is_same = outer.origin == 0.0 and outer.time == 1.0 and np.all(outer.size == 1.0)
    if not isinstance(inner, Scaling) or not is_same:
        return outer
    return dataclasses.replace(inner, unit=outer.unit * inner.unit)


def _function(factory, t0, T, S, factor):
    """Return the factory of factor g(t0 + T tau, S y)."""
    if factory is None:
        return None

    def make(xp):
        g = factory(xp)
        size = S + 0.0
        unit = factor + 0.0
        if xp.__name__ != "numpy":
            size = xp.asarray(size)
            unit = xp.asarray(unit)

        def scaled(t: float, x: np.ndarray) -> np.ndarray:
            return unit * xp.asarray(g(t0 + T * t, size * x))

        if xp.__name__ == "numpy":
            scaled.scaling = _composed(Scaling(g, t0, T, size, unit))
        return scaled

    return make


def _curve(factory, t0, T, factor):
    """Return the factory of factor b(t0 + T tau); of numbers, factor times them."""
    if factory is None or not callable(factory):
        return None if factory is None else factory * factor

    def make(xp):
        b = factory(xp)

        def scaled(t: float) -> np.ndarray:
            return xp.asarray(b(t0 + T * t)) * factor

        return scaled

    return make


def _gradient_system(p: Complementarity, t0: float, T: float, L: float) -> Complementarity:
    """Return the gradient system in the units T and L."""
    families = []
    one = np.ones(1)
    for c in p.constraints:
        if isinstance(c, Affine):
            families.append(dataclasses.replace(c, b=_curve(c.b, t0, T, 1.0 / L)))
        elif isinstance(c, Distance):
            sizes = {k: getattr(c, k) for k in ("d", "radii") if getattr(c, k) is not None}
            sizes = {k: v / L for k, v in sizes.items()}
            families.append(
                dataclasses.replace(c, anchors=_curve(c.anchors, t0, T, 1.0 / L), **sizes)
            )
        else:
            families.append(
                Smooth(
                    _function(c.g, t0, T, L * one, one / L),
                    _function(c.gradient, t0, T, L * one, one),
                    _function(c.rate, t0, T, L * one, T / L * one),
                )
            )
    return Complementarity(_function(p.drift, t0, T, L * one, T / L * one), tuple(families))


def _filippov(p: Filippov, t0: float, T: float, S: np.ndarray) -> Filippov:
    """Return the Filippov system in the units T and S; its switches have the user's."""
    return Filippov(
        None, _function(p.switch, t0, T, S, np.ones(1)), _signed(p.field, t0, T, S), p.d
    )


def _hybrid(p: Hybrid, t0: float, T: float, S: np.ndarray) -> Hybrid:
    """Return the hybrid system in the units T and S; its guards have the user's."""
    transitions = tuple(
        dataclasses.replace(
            tr,
            guard=_function(tr.guard, t0, T, S, 1.0),
            reset=_function(tr.reset, t0, T, S, 1.0 / S),
        )
        for tr in p.transitions
    )
    modes = {name: _function(drift, t0, T, S, T / S) for name, drift in p.modes.items()}
    return Hybrid(modes, transitions, p.initial)


def _lcs(p: LCS, t0: float, T: float, S: np.ndarray) -> tuple[LCS, float, float]:
    """Return the linear complementarity system in the units T and S, and those of lambda and w."""
    w = power_of_two(np.abs(p.C * S).max(initial=0.0) or 1.0)
    force = np.abs(p.B / S[:, None]).max(initial=0.0)
    unit = power_of_two(1.0 / (T * force)) if force else 1.0
    system = LCS(
        T * (p.A / S[:, None]) * S,
        T * unit * (p.B / S[:, None]),
        p.C * S / w,
        p.D * (unit / w),
        _curve(p.u, t0, T, T / S),
        _curve(p.q, t0, T, 1.0 / w),
    )
    return system, float(unit), float(w)
