"""Entry point of the error bars: decide whether a run can have them, scale it, compute them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.compilation.announcement import announced_compilation
from nsbench.dynamics.scaling.estimate import particle_distance
from nsbench.dynamics.scaling.scaled_case import ScaledCase, scaled_case
from nsbench.problem import Affine, Complementarity, Distance
from nsbench.trajectory import Trajectory

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

FINISHED = ("ok", "unverified", "degenerate", "below_reference")
FAR = 0.1  # of the distance of particles: an error this large is none that a linearisation knows
# of an estimate: allowance for what its linearisation leaves out, terms of second order in the
# error
LINEARISED = 1.25
LARGEST = 700  # coordinates, or acting contacts, of a run whose error bars are computed


@dataclass(frozen=True)
class Bars:
    """Error bars at the samples, each (k,), in the 2-norm; NaN where there are none.

    state, reaction: of x and of the cumulative reaction. impulse: of the cumulative impulses, the
    reaction's over the least singular value of the active gradients: an estimate always.
    lam_variation: sum over contacts and recorded times of the changes of mean multipliers, whose
    boundedness is what order one rests on. is_proven: are state and reaction bounds? If not they
    are estimates. why: a sentence where there are none, or where they are not to be trusted.
    distance (k,): of the samples from the feasible comparison curve, and gained (k - 1,): by how
    much the error of that curve may have grown in each sample interval: what `state` is made of.
    vector (k, n): of an estimate, the error itself, and unallowed (k,) its size, both without an
    allowance for what is linearised; of a bound there is none.
    """

    t: np.ndarray
    state: np.ndarray
    reaction: np.ndarray
    impulse: np.ndarray
    lam_variation: float = float("nan")
    is_proven: bool = False
    why: str = ""
    distance: np.ndarray = field(default_factory=lambda: np.empty(0))
    gained: np.ndarray = field(default_factory=lambda: np.empty(0))
    vector: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    unallowed: np.ndarray = field(default_factory=lambda: np.empty(0))

    @classmethod
    def none(cls, t: np.ndarray, why: str) -> Bars:
        """Return the error bars of a run that has none."""
        nothing = np.full(len(t), np.nan)
        return cls(t, nothing, nothing, nothing, why=why)

    def confirmed(self, x: np.ndarray, coarser: Bars, coarser_x: np.ndarray) -> Bars:
        """Return the estimate with the allowance that a second run of the case shows to be needed.

        x, coarser_x (k, n): states at the samples of this run and of one with longer steps. What
        the errors of both differ by is known: the allowance is the part of it, up to each sample,
        that the estimated errors `vector` miss. It falls with the steps, so that of the shorter
        ones it is less. Bounds, and runs beside one without an estimate, stay as they are.
        """
        if not (self.vector.size and coarser.vector.size):
            return self
        moved = coarser_x - x
        missed = np.linalg.norm(coarser.vector - self.vector - moved, axis=1)
        seen = np.maximum.accumulate(np.linalg.norm(moved, axis=1))
        needed = np.maximum.accumulate(missed) / np.maximum(seen, 1e-300)
        return self.allowed(np.where(seen > 0.0, needed, np.inf))

    def allowed(self, share: float | np.ndarray) -> Bars:
        """Return the estimate with an allowance of this share (k,) of it, where that is less."""
        if not self.vector.size:
            return self
        spared = np.maximum(LINEARISED - 1.0 - share, 0.0)
        return dataclasses.replace(self, state=self.state - spared * self.unallowed)


class ErrorBars:
    """Error bars of a run, computed when they are first asked for.

    Its attributes are those of `Bars`: t, state, reaction, impulse (k,), lam_variation, is_proven,
    why.
    """

    def __init__(self, make: Callable[[], Bars]):
        self._make = make

    @cached_property
    def made(self) -> Bars:
        """The computed error bars."""
        return self._make()

    def __getattr__(self, name: str):
        if name.startswith("_") or name not in Bars.__dataclass_fields__:
            raise AttributeError(name)
        return getattr(self.made, name)

    def __repr__(self) -> str:
        return f"ErrorBars({'not computed yet' if 'made' not in self.__dict__ else self._words()})"

    def _words(self) -> str:
        kind = "bound" if self.is_proven else "estimate"
        return self.why or f"{kind}: state {np.nanmax(self.state, initial=0.0):.3g}"


def error_bars(case: Case, traj: Trajectory) -> ErrorBars:
    """Return the error bars of a run of a gradient system by a fixed-step method.

    The run is one that recorded states between its samples where it made many steps
    (`Trajectory.between`). Nothing raises: a run without error bars says why.
    """
    return ErrorBars(lambda: _computed(case, traj))


def _computed(case: Case, traj: Trajectory) -> Bars:
    why = _refusal(case, traj)
    if why:
        return Bars.none(traj.t, why)
    own = scaled_case(case)
    try:
        # matrices are small: threads of BLAS would cost ten times what they compute
        one_thread = _thread_pools().limit(limits=1, user_api="blas")
        compiling = announced_compilation("error bars")
        with np.errstate(all="ignore"), own.in_user_units(), one_thread, compiling:
            found = _in_own_units(case, own, own.scaled(traj))
    except Exception as e:  # a drift may raise anything at a state near those of the run
        return Bars.none(traj.t, f"They could not be computed: {type(e).__name__}: {e}")
    return restored_bars(found, traj.t, own)


@functools.cache
def _thread_pools() -> ThreadpoolController:
    """Return the thread pools of this process: to look for them takes milliseconds."""
    import scipy.linalg  # noqa: F401  (its pool is looked for as well)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def restored_bars(found: Bars, t: np.ndarray, own: ScaledCase) -> Bars:
    """Return error bars in own units in those of the user; t (k,): the sample times.

    Where coordinates have units of their own, the largest is taken: a bar in the 2-norm is no bar
    of a small coordinate.
    """
    length = float(np.max(own.state))
    return dataclasses.replace(
        found,
        t=t,
        state=found.state * length,
        reaction=found.reaction * length,
        impulse=found.impulse * own.impulse,
        lam_variation=found.lam_variation * own.multiplier,
        distance=found.distance * length,
        gained=found.gained * length,
        vector=found.vector * own.state if found.vector.size else found.vector,
        unallowed=found.unallowed * length,
    )


def without_error_bars(case: Case) -> str:
    """Return why no run of the case has error bars, "" if runs may have them."""
    if not isinstance(case.problem, Complementarity):
        return "Error bars are computed for constraints alone, not for switches, modes or an LCS."
    if len(case.t) < 3:
        return "Error bars need three samples at least."
    if case.n > LARGEST:
        return f"{case.n} coordinates: error bars are computed for {LARGEST} at most."
    return ""


def _refusal(case: Case, traj: Trajectory) -> str:
    """Return why a run has no error bars, "" if it has."""
    if why := without_error_bars(case):
        return why
    if traj.status.code not in FINISHED or not np.all(np.isfinite(traj.x)):
        return "The run did not reach its end."
    if not traj.reaction.size:
        return "The run has no reaction."
    if len(traj.contacts) > 8 * LARGEST:
        return f"{len(traj.contacts)} contacts acted: too many to close at once."
    return ""


def is_convex(problem: Complementarity) -> bool:
    """Is the feasible set convex, with flat faces: affine rows, and distances in one dimension?"""
    return all(
        isinstance(c, Affine) or (isinstance(c, Distance) and c.dim == 1)
        for c in problem.constraints
    )


def _in_own_units(given: Case, own: ScaledCase, traj: Trajectory) -> Bars:
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.error_bars.bars import Path
    from nsbench.error_bars.drift import Drift

    case = own.case
    nodes = _nodes(traj)
    proven = is_convex(case.problem)
    scene = ConstraintSet(case.problem, case.n)
    drift = Drift(given.problem.drift, case.n, own.origin, own.time, own.length)
    path = Path(scene, drift, nodes, gives_up=not proven)
    passed = proven and path.has_passed()
    proven = proven and not passed
    at = np.searchsorted(nodes.t, traj.t)
    parts = path.bound() if proven else path.estimate()
    if proven and not parts.is_proven:  # no bound of the drift's derivative: as along other curves
        parts = path.estimate()
    proven = parts.is_proven and path.is_complete and path.is_feasible
    # rounding of one addition per step, which no residual shows
    rounding = float(np.spacing(np.abs(traj.x).max())) * traj.stats.get("steps", len(nodes.t))
    own_drift = traj.x - traj.x[0] - traj.reaction
    off = np.linalg.norm(parts.known[at] - (own_drift - path.curve_drift()[at]), axis=1)
    state = parts.state[at] + rounding
    reaction = parts.factor * off + parts.reaction[at] + rounding
    if not np.all(np.isfinite(state)):
        return Bars.none(traj.t, "The motions near the run are not finite.")
    impulse = np.maximum.accumulate(reaction) / path.least_singular_values()[at]
    why = _doubt(path, state.max(), particle_distance(case), proven)
    if is_convex(case.problem) and not path.is_feasible:
        why = "No states near the run were found that violate no constraint."
    if passed:
        why = "Particles have passed through one another: the run is in another order."
    distance = np.linalg.norm((nodes.x - path.Y)[at], axis=1)
    gained = np.add.reduceat(path.size, at[:-1])
    variation = path.multiplier_variation()
    found = traj.t, state, reaction, impulse, variation, proven, why, distance, gained
    return Bars(*found, *(v[at] for v in (parts.vector, parts.unallowed) if len(v)))


def _doubt(path, size: float, distance: float, proven: bool) -> str:
    """Return why an estimate of this size is not to be trusted, "" if it is."""
    if not path.is_complete:
        return "Contacts close and open too often to be followed one by one."
    if not proven and distance and size > FAR * distance:
        return "The estimate is not small beside the sizes of the scene: it is a linearisation."
    return ""


def _nodes(traj: Trajectory):
    """Merge the samples with the states recorded between them."""
    from nsbench.error_bars.bars import Nodes

    t = traj.t
    x = traj.x
    impulse = traj.impulse
    if traj.between is not None and len(traj.between[0]):
        merged = zip((t, x, impulse), traj.between, strict=True)
        t, x, impulse = (np.concatenate(pair) for pair in merged)
        order = np.argsort(t, kind="stable")
        t, x, impulse = t[order], x[order], impulse[order]
    return Nodes(t, x, impulse, tuple(traj.contacts))
