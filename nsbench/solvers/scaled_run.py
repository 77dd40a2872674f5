"""Run a method on a case in the case's own units, check it there, return it in the user's.

A method that says `scaled = True` gets the case in units of its own (nsbench.dynamics.scaling), so
that its constants mean the same in every unit. The others, whose arithmetic is homogeneous or whose
scripts know the case, get it as it is. Checks of a finished run see own units in either case.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import Scale
from nsbench.diagnostics import diagnose
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.dynamics.scaling.estimate import particle_distance, scale_of_sizes
from nsbench.dynamics.scaling.scaled_case import ScaledCase, scaled_case, with_own_switches
from nsbench.error_bars import ErrorBars, error_bars, restored_bars
from nsbench.problem import Complementarity
from nsbench.solvers.base import Run, Solver
from nsbench.solvers.common.initial_state import initial_state
from nsbench.trajectory import Status, Trajectory

# A coordinate that stays below its estimated size by more than this factor loses digits to a
# tolerance that is relative to that size: the run is made again with the sizes that were found.
TOO_LARGE = 16.0
COMPARED = tuple(f.name for f in dataclasses.fields(Trajectory) if f.compare)
AT_REST = 2.0**-40  # of its estimated size: a coordinate that stays below is zero but for rounding


@dataclass(frozen=True)
class Checked:
    """The trajectory that was checked last, the units it is in, its status, and error bars from a
    second run that a check may have made."""

    traj: Trajectory
    own: ScaledCase | None
    status: Status
    pair: ErrorBars | None = None


class ScaledRun:
    """A prepared run of a method, to be called for its trajectory in the units it works in.

    `to_user_units` and `check_and_convert` are outside of what the clock measures.
    """

    def __init__(self, method: Solver, case: Case, accuracy: float):
        self.method = method
        self.case = case
        self.asked = accuracy
        self.is_scaled = getattr(method, "scaled", False)
        self.own: ScaledCase | None = None
        self.has_sizes = False  # has a run shown whether they were estimated too large?
        self.last_checked: Checked | None = None
        self.prepare(None)

    def prepare(self, scale: Scale | None) -> None:
        """Prepare the method on the case in the units `scale`; None: those of the case."""
        if not self.is_scaled:
            self.run = _callable_run(self.method, self.method.prepare(self.case, self.asked))
            return
        self.own = scaled_case(self._from_feasible_start(), scale)
        value = self.own.accuracy(self.method.accuracy, self.asked)
        with self.own.in_user_units():
            prepared = self.method.prepare(with_own_switches(self.own.case), value)
            self.run = _callable_run(self.method, prepared)

    def _from_feasible_start(self) -> Case:
        """Return the case from where its policy for starts puts it, in the user's units.

        Raises what nsbench.solvers.common.initial_state raises.
        """
        case = self.case
        if not getattr(case.problem, "constraints", ()):
            return case
        x0 = initial_state(case, scene_of(case))
        return case if np.array_equal(x0, case.x0) else case.replace(x0=x0)

    def __call__(self) -> Trajectory:
        """Run; once more, with the sizes that were found, where those were estimated too large.

        A run that failed may have failed for that reason.
        """
        if not self.is_scaled:
            return self.run()
        with self.own.in_user_units():
            traj = self.run()
        if not isinstance(traj, Trajectory):  # reported by whoever asked for the run
            return traj
        found = None if self.has_sizes else self._overestimated(traj)
        self.has_sizes = True
        if found is None:
            return traj
        self.prepare(scale_of_sizes(self.case, found))
        with self.own.in_user_units():
            return self.run()

    def _overestimated(self, traj: Trajectory) -> np.ndarray | None:
        """Return the sizes (n,) of the samples, where the units are much larger; else None."""
        if self.case.scale is not None or self.method.accuracy != "tol":
            return None
        own = self.own.case
        x = np.vstack([own.x0, traj.x])
        if isinstance(own.problem, Complementarity):  # of one length
            moved = 0.5 * float(np.nanmax(np.abs(x - own.x0)))
            found = np.full(own.n, max(moved, particle_distance(own)))
        else:
            # of a run that failed little is known but where it was
            start = own.x0 if traj.status.ok else 0.0
            found = np.nanmax(np.abs(x - start), axis=0)
        found = np.where(found > AT_REST, found, 1.0)
        return None if np.all(found * TOO_LARGE > 1.0) else found * self.own.state

    def to_user_units(self, traj: Trajectory) -> Trajectory:
        """Convert the trajectory to the units of the user."""
        restores = self.is_scaled and isinstance(traj, Trajectory)
        return self.own.restored(traj, self.case.t) if restores else traj

    def check_and_convert(self, traj: Trajectory) -> Trajectory:
        """Check the trajectory, and return it in the units of the user with its error bars."""
        return self.add_status_and_bars(traj, self.to_user_units(traj), self.known_checks(traj))

    def add_status_and_bars(
        self, traj: Trajectory, converted: Trajectory, known: Checked | None = None
    ) -> Trajectory:
        """Check a trajectory; return it, converted to the user's units, with status and error bars.

        traj: in the units that the method works in; known: what `known_checks` says of it.
        """
        known = known or self.run_checks(traj)
        is_known = converted.status == known.status
        out = converted if is_known else dataclasses.replace(converted, status=known.status)
        bars = self._bars(out, known.pair)
        return out if bars is out.bound else dataclasses.replace(out, bound=bars)

    def _pair(self, traj: Trajectory) -> ErrorBars:
        """Return error bars of a run in own units from one with a looser tolerance."""
        from nsbench.solvers.event_driven.amplified_error import tolerance_pair

        return tolerance_pair(self.method, with_own_switches(self.own.case), traj, self.asked)

    def _bars(self, traj: Trajectory, pair: ErrorBars | None) -> ErrorBars | None:
        """Return the error bars of a run in the user's units, where the method has any."""
        if pair is not None:
            own = self.own
            return ErrorBars(lambda: restored_bars(pair.made, traj.t, own))
        if traj.bound is None and getattr(self.method, "has_error_bars", False):
            return error_bars(self.case, traj)
        return traj.bound

    def known_checks(self, traj: Trajectory) -> Checked | None:
        """Return what the checks found in the last trajectory, if this one has its bytes.

        Checks depend on case and trajectory alone: none of them need be made again.
        """
        last = self.last_checked
        is_known = last is not None and last.own is self.own and is_same_run(last.traj, traj)
        return last if is_known else None

    def run_checks(self, traj: Trajectory) -> Checked:
        """Check the trajectory; return its status, and what was compared for it."""
        own = self.own or scaled_case(self.case)
        in_own_units = traj if self.is_scaled else own.scaled(traj)
        pair = None
        if getattr(self.method, "has_tolerance_pair", False) and traj.status.ok:
            pair = self._pair(in_own_units)
            in_own_units = dataclasses.replace(in_own_units, bound=pair)
        with own.in_user_units():
            status = diagnose(own.case, in_own_units, getattr(self.method, "checks", ())).status
        self.last_checked = Checked(traj, self.own, status, pair)
        return self.last_checked


def is_same_run(one: Trajectory, other: Trajectory) -> bool:
    """Are all fields of two trajectories equal, arrays bit for bit?"""
    return all(_is_same(getattr(one, name), getattr(other, name)) for name in COMPARED)


def _is_same(a: object, b: object) -> bool:
    """Are two values equal? Arrays by their bytes, so that 0.0 and -0.0 differ and NaN does not."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_is_same, a, b))
    return type(a) is type(b) and bool(a == b)


def _callable_run(method: Solver, run: object) -> Run:
    """Return what a method has prepared; TypeError with the remedy if it cannot be called."""
    if not callable(run):
        raise TypeError(
            f"prepare of {type(method).__name__} returns {type(run).__name__}; it must return the "
            f"function that runs: is its last line, `return run`, missing?"
        )
    return run
