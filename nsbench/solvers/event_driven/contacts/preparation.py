"""Choose the compiled or the Python event loop for a constrained case, and prepare its run."""

from __future__ import annotations

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers.base import Run
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.event_driven.contacts import compiled_loop
from nsbench.solvers.event_driven.contacts.drift_program import trace_drift
from nsbench.solvers.event_driven.contacts.evaluation import ContactField
from nsbench.solvers.event_driven.contacts.host_loop import ContactIntegrator
from nsbench.solvers.event_driven.contacts.kinked_drift import KinkedDrift
from nsbench.solvers.event_driven.slow_path import HostNotes
from nsbench.trajectory import Status, Trajectory


def prepare(case: Case, options, tol: float) -> Run:
    """Prepare a run of a Complementarity case, compiled where the case allows it.

    options: an EventDriven method. tol: tolerance of the arcs. Raises ValueError for an infeasible
    start.
    """
    import scipy.integrate  # noqa: F401  (loaded here, not in the timed run)

    constraints = ConstraintSet(case.problem, case.n)
    x = initial_state(case, constraints)
    field = ContactField(case, constraints)
    why = compiled_loop.why_in_python(options, constraints)
    setup = None if why else compiled_loop.plan_affine_run(case, field, x, tol)
    traced, untraced = trace_drift(case, needs_kinks=bool(why)) if setup is None else (None, "")
    kinks = None
    if traced is not None and traced.places:
        kinks = KinkedDrift(traced)
        why = why or "the drift has a kink, and the compiled loop of contacts takes smooth ones"
    elif traced is not None and not why:
        setup = compiled_loop.plan_traced_run(traced, field, tol)
    why = why or f"the drift cannot be traced: {untraced}" * bool(untraced)
    field.compile(float(case.t[0]), x, arcs=setup is None)
    notes = HostNotes(why or "the compiled loop does not get to the end", untraced)
    new = lambda: ContactIntegrator(case, constraints, x.copy(), options, tol, kinks, notes)
    if setup is not None:
        compiled_loop.load(new(), setup)

    def run() -> Trajectory:
        if setup is not None:
            integrator = new()
            if compiled_loop.run(integrator, setup):
                return integrator.trajectory(Status())
        return new().run()

    return run
