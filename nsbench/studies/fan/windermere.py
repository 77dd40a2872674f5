"""Lady Windermere's fan: local defects of a method, each carried to the end by the exact flow.

Steps t_0 < ... < t_N = T of a method give x_0 .. x_N; phi(x; s, t) is the exact flow from x at s,
where a state that violates constraints starts from the nearest feasible one. With
y_n+1 = phi(x_n; t_n, t_n+1),

    x_N - x(T) = [x_N - P x_N] + sum_n part_n,
    part_n = phi(x_n+1; t_n+1, T) - phi(y_n+1; t_n+1, T),

P the nearest feasible state. defect_n = P x_n+1 - y_n+1 is the local defect, and
|part_n| / |defect_n| by how much the flow changes it. The flow is the event-driven method, right to
about 1e-12. Nothing is telescoped: y_n+1 is carried on by a run of its own, so that the parts add
up to the error only as far as all runs agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.solvers.common.initial_state import initial_state
from nsbench.studies.runs.finished_run import finish
from nsbench.trajectory import Trajectory

FREE = "free"
EVENT = "event"
CONTACT = "contact"
PHASES = (FREE, EVENT, CONTACT)
NO_DEFECT = 1e-11  # a defect below it is rounding of the reference: no ratio is formed


@dataclass(frozen=True)
class Fan:
    """The fan of one run with N steps.

    t (N + 1,), defects (N, n), parts (N, n); violation (n,): x_N - P x_N; error (n,): x_N - x(T),
    from the closed form or a run of its own. phases: of each step, whether the exact solution from
    the start of the case is free in it, has an event, or keeps its contacts.
    """

    t: np.ndarray
    defects: np.ndarray
    parts: np.ndarray
    violation: np.ndarray
    error: np.ndarray
    phases: tuple[str, ...]

    @property
    def mismatch(self) -> float:
        """Return |violation + sum of parts - error| over |error|, in the largest coordinate.

        An error that is rounding of the reference counts as NO_DEFECT.
        """
        total = self.violation + self.parts.sum(axis=0)
        size = max(float(np.abs(self.error).max()), NO_DEFECT)
        return float(np.abs(total - self.error).max() / size)

    def along_error(self, part: np.ndarray) -> float:
        """Return the share of the error that a part (n,) makes; NaN where there is no error."""
        if np.abs(self.error).max() < NO_DEFECT:
            return float("nan")
        return float(part @ self.error / (self.error @ self.error))

    @property
    def growth(self) -> float:
        """Return the largest |part| / |defect|; NaN where all defects are rounding."""
        size = np.linalg.norm(self.defects, axis=1)
        used = size > NO_DEFECT
        if not used.any():
            return float("nan")
        return float((np.linalg.norm(self.parts[used], axis=1) / size[used]).max())

    def share(self, phase: str) -> float:
        """Return the part of the steps of a phase, along the error, over the error."""
        chosen = np.array([p == phase for p in self.phases])
        return self.along_error(self.parts[chosen].sum(axis=0))

    def share_before_last_event(self) -> float:
        """Return the share of the steps before the last one that holds an event."""
        events = [n for n, p in enumerate(self.phases) if p == EVENT]
        return self.along_error(self.parts[: events[-1] if events else 0].sum(axis=0))

    def largest_defect(self, phase: str) -> float:
        """Return the largest norm of a local defect in a phase; NaN without such steps."""
        chosen = np.array([p == phase for p in self.phases])
        sizes = np.linalg.norm(self.defects[chosen], axis=1)
        return float(sizes.max()) if sizes.size else float("nan")


def open_fan(case: Case, method: str, end: float, steps: int) -> Fan:
    """Run a method with equal steps to time `end` and carry every local defect there.

    Raises ArithmeticError, with the status, where a run does not end well.
    """
    t = np.linspace(float(case.t[0]), end, steps + 1)
    x = finish(without_answers(case, t), method, (end - t[0]) / steps).x
    flow = [carry(case, x[n], t[n], end) for n in range(1, steps)]
    flow.append(project(case, x[steps], end))
    defects = []
    parts = []
    for n in range(steps):
        y = carry(case, x[n], t[n], t[n + 1])
        last = n == steps - 1
        parts.append(flow[n] - (y if last else carry(case, y, t[n + 1], end)))
        defects.append(project(case, x[n + 1], t[n + 1]) - y)
    solution = step_exactly(case, case.x0, t[0], end, t)
    exact = solution.x[-1] if case.exact is None else case.exact(t[-1:])[0]
    return Fan(
        t,
        np.array(defects),
        np.array(parts),
        x[-1] - flow[-1],
        x[-1] - exact,
        _phases(solution),
    )


def carry(case: Case, x: np.ndarray, start: float, end: float) -> np.ndarray:
    """Return the state at `end` of the exact flow from x at `start`."""
    return step_exactly(case, x, start, end).x[-1]


def step_exactly(
    case: Case, x: np.ndarray, start: float, end: float, samples: np.ndarray | None = None
) -> Trajectory:
    """Follow the exact flow from x at `start`, or from the nearest feasible state, to `end`.

    samples: the sample times, from `start` to `end`; by default these two.
    """
    t = np.array([start, end]) if samples is None else samples
    return finish(without_answers(case, t).replace(x0=x, start="project"), "event_driven")


def project(case: Case, x: np.ndarray, time: float) -> np.ndarray:
    """Return the feasible state nearest to x at this time: where the exact flow from x starts."""
    t = np.array([time, time + 1.0])
    from_x = without_answers(case, t).replace(x0=x, start="project")
    return np.asarray(initial_state(from_x, scene_of(from_x)))


def without_answers(case: Case, t: np.ndarray) -> Case:
    """Return the case at other times, without what is known of its own solution."""
    return case.replace(
        t=t, exact=None, exact_impulse=None, exact_events=None, contacts=None, distance=None
    )


def _phases(traj: Trajectory) -> tuple[str, ...]:
    """Phase of each interval between samples: by the events in it, then by its impulse."""
    out = []
    acting = np.diff(traj.impulse, axis=0).max(axis=1, initial=0.0) > 0.0
    for n, (start, end) in enumerate(zip(traj.t[:-1], traj.t[1:], strict=True)):
        has_event = any(start < e.t <= end for e in traj.events)
        out.append(EVENT if has_event else CONTACT if acting[n] else FREE)
    return tuple(out)
