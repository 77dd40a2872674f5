"""List the integrators of smooth arcs: one line for each.

A new integrator is a line of INTEGRATORS; `method` of event_driven offers its name.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Integrator:
    """Properties of a stepper of scipy.integrate.

    stepper: name of its class. defect: local errors by which the dense output of a step may miss
    the equation at a point: dense outputs are of lower order than the step, those of implicit
    methods of much lower. explicit: the dense output is one order below the step, so that the
    integral of its defect is the error of the step. multistep: it keeps a history, which cannot be
    projected, and restarts at every stop. detects_stiffness: its last two stages are at the end of
    the step, so that they show whether the equation bounds the steps (the sign to go on with
    `radau`).
    """

    stepper: str
    defect: float
    explicit: bool = False
    multistep: bool = False
    detects_stiffness: bool = False


INTEGRATORS = {
    "dop853": Integrator("DOP853", defect=1e5, explicit=True, detects_stiffness=True),
    "rk45": Integrator("RK45", defect=1e6, explicit=True),
    "radau": Integrator("Radau", defect=1e8),
    "lsoda": Integrator("LSODA", defect=1e8, multistep=True),
}
STIFF_INTEGRATOR = "radau"  # takes over where an equation proves to be stiff
