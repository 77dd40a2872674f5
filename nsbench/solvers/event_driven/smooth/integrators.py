"""Table of the integrators of smooth arcs: the class that takes the steps, and what holds of it.

A new integrator is a line of INTEGRATORS; `method` of event_driven offers its name. Its class may
be one of scipy.integrate or of a module of one's own. What it must offer is a part of
scipy.integrate.OdeSolver:

    Stepper(fun, t, y, t_bound, rtol=, atol=, max_step=, first_step=)
                        y (n,); atol a number or (n,); first_step is left out where none is known
    step()              take one step; returns None, or why it failed
    status              "running", "finished" at t_bound, or "failed"
    t, y, step_size     end of the last step, state (n,) there, and its length
    dense_output()      the path u of the last step: u(t) -> (n,), u(times) -> (n, len(times))
    t_bound, status     are set, to go on to the next stop
    h_abs, y, f         are set: wish for the next step; state and slope after a projection
    max_step            is set, to take a refused step again
    A, K                with `end_stages` alone: coefficients (s, s) and slopes of the stages

Of a multistep integrator, which is new after every stop, h_abs and f are neither read nor set; of
the others max_step is not set. A new integrator is tested by
tests/solvers/event_driven/test_filippov.py::test_every_integrator_gets_there with its name added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver


class EndStages(NamedTuple):
    """Two stages of a Runge-Kutta step that are both at its end, by their numbers from 0.

    inner: the last stage of the step. solution: the slope at the state that the step returns.
    """

    inner: int
    solution: int


@dataclass(frozen=True)
class Integrator:
    """A stepper for smooth arcs, and its properties.

    load: returns its class; a function, so that scipy.integrate is imported when it is first used.

    defect: local errors atol + rtol |u| by which h |u' - f(t, u)| may exceed zero at the nodes of a
    step of length h (pieces.shorter_step): dense outputs are of lower order than the step, those of
    implicit methods of much lower. Its measure is the largest of these ratios over steps of smooth
    equations. For oscillators, van der Pol's and Lotka-Volterra's at tolerances from 1e-6 to 1e-12
    it is 340 with DOP853, 570 with RK45 and 10 to 20 with Radau and LSODA. The numbers here are
    larger by a hundred and more: too large a number finds less of what a step has missed, too small
    a one refuses good steps.

    explicit: the dense output is one order below the step, so that the integral of its defect is
    the error of the step. multistep: it keeps a history, which cannot be projected, and restarts at
    every stop. end_stages: stages that show whether the equation bounds the steps, the sign to go
    on with STIFF_INTEGRATOR (smooth.stiffness); None: it has no such test.
    """

    load: Callable[[], type[OdeSolver]]
    defect: float
    explicit: bool = False
    multistep: bool = False
    end_stages: EndStages | None = None


def _dop853() -> type[OdeSolver]:
    from scipy.integrate import DOP853

    return DOP853


def _rk45() -> type[OdeSolver]:
    from scipy.integrate import RK45

    return RK45


def _radau() -> type[OdeSolver]:
    from scipy.integrate import Radau

    return Radau


def _lsoda() -> type[OdeSolver]:
    from scipy.integrate import LSODA

    return LSODA


INTEGRATORS = {
    # DOP853 has the stages 0 .. 11 and, as 12, the first one of the next step
    "dop853": Integrator(_dop853, defect=1e5, explicit=True, end_stages=EndStages(11, 12)),
    "rk45": Integrator(_rk45, defect=1e6, explicit=True),
    "radau": Integrator(_radau, defect=1e8),
    "lsoda": Integrator(_lsoda, defect=1e8, multistep=True),
}
STIFF_INTEGRATOR = "radau"  # takes over where an equation proves to be stiff
