"""What no solution does is not called ok, whatever passed over it: poles of the drift, walls
without room between two samples."""

import math
from pathlib import Path

import numpy as np
import pytest
from event_scenes import relays

from nsbench import LCS, Affine, Case, Complementarity, Distance, Filippov, solvers
from nsbench.diagnostics.drift_poles import check_drift_pole
from nsbench.diagnostics.run_view import RunView

POLES = {  # of (xp, t, x), x starting at 1, over [0, 1]
    "simple": lambda xp, t, x: 1.0 / (t - 0.3001),
    "faint": lambda xp, t, x: 1e-6 / (t - 0.3001),
    "double": lambda xp, t, x: 1.0 / (t - 0.3001) ** 2,
    "double, as a product": lambda xp, t, x: 1e-3 / ((t - 0.3001) * (t - 0.3001)),
    "negative power": lambda xp, t, x: (t - 0.3001) ** -1.0,
    "tangent": lambda xp, t, x: xp.tan(3.0 * t),
    "reciprocal": lambda xp, t, x: xp.reciprocal(t - 0.3001),
    "of an array": lambda xp, t, x: xp.sum(1.0 / xp.array([t - 0.3001, t + 2.0])),
    "of a root": lambda xp, t, x: xp.sqrt(xp.abs(t - 0.3001)) ** -2.0,
    "of floats": lambda xp, t, x: 1.0 / (float(t) - 0.3001),
    "of math": lambda xp, t, x: 1.0 / math.sin(t - 0.3001),
    "other divisions later": lambda xp, t, x: (
        1.0 / (t - 0.3001) if t < 0.5 else 0.1 / (t + 1.0) / (x[0] + 3.0)
    ),
    "behind a branch": lambda xp, t, x: xp.where(t < 2.0, 1.0 / (t - 0.3001), 0.0),
}
NONE = {
    "integrable": lambda xp, t, x: 1.0 / xp.sqrt(xp.abs(t - 0.3001)),
    "removable": lambda xp, t, x: xp.sin(t - 0.3001) / (t - 0.3001),
    "hidden": lambda xp, t, x: xp.where(xp.abs(t - 0.3001) > 1e-9, 0.1, 1.0 / (t - 7.0)),
    "narrow peak": lambda xp, t, x: 1.0 / (1e-3 + (t - 0.3001) ** 2),
    "logarithmic, integrable": lambda xp, t, x: (
        0.1 / ((t - 0.3001) * xp.log(xp.abs(t - 0.3001)) ** 2)
    ),
    "peak of floats": lambda xp, t, x: 1e-5 / (1e-6 + (float(t) - 0.3001) ** 2),
    "before the start": lambda xp, t, x: 0.01 / (t + 1e-3),
    "logarithm": lambda xp, t, x: 0.1 * xp.log(xp.abs(t - 0.3001)),
    "smaller than a root of the smallest number": lambda xp, t, x: 1e-200 / (1e-200 * (1.0 + t)),
    "saturation": lambda xp, t, x: -x[0] / (0.1 + x[0]),
}


def _case(term, t=(0.0, 0.5, 1.0)):
    def drift(xp):
        return lambda t, x: xp.array([term(xp, t, x)])

    return Case(name="pole", problem=Complementarity(drift), x0=np.array([1.0]), t=np.array(t))


@pytest.mark.survives("blow-up")
@pytest.mark.parametrize("term", POLES.values(), ids=POLES)
def test_a_pole_between_samples_is_told(term):
    case = _case(term)
    status = solvers.solve(case, "euler", h=3.7e-4).status
    assert status.code == "diverged" and "pole" in str(status)


@pytest.mark.parametrize("term", NONE.values(), ids=NONE)
def test_what_is_no_pole_is_not(term):
    assert solvers.solve(_case(term), "euler", h=3.7e-4).status.ok


@pytest.mark.parametrize("samples", (2, 3, 20, 1001))
def test_a_pole_is_found_with_few_samples_and_many(samples):
    case = _case(POLES["simple"], np.linspace(0.0, 1.0, samples))
    assert solvers.solve(case, "euler", h=3.7e-4).status.code == "diverged"


def test_a_pole_of_the_state():
    """x' = 1 + 1e-3 / (x - 1.5001)^2 has a solution that passes; steps beside the pole know nothing
    of it."""
    case = _case(lambda xp, t, x: 1.0 + 1e-3 / (x[0] - 1.5001) ** 2)
    assert solvers.solve(case, "euler", h=3.7e-4).status.code == "unverified"


def test_poles_of_fields_and_inputs():
    def mode(xp):
        return lambda t, x: xp.array([1.0 + 1.0 / (t - 0.3001)])

    def other(xp):
        return lambda t, x: xp.array([-0.5 + 0.0 * x[0]])

    def switch(xp):
        return lambda t, x: xp.array([x[0] - 100.0])

    field = Case(
        name="field",
        problem=Filippov({(1,): other, (-1,): mode}, switch),
        x0=np.array([1.0]),
        t=np.linspace(0, 1, 4),
    )
    assert solvers.solve(field, "euler", h=3.7e-4).status.code == "diverged"
    beside = field.replace(
        problem=Filippov({(1,): mode, (-1,): other}, switch)
    )  # the mode with the pole is never met
    assert solvers.solve(beside, "euler", h=3.7e-4).status.ok

    def u(xp):
        return lambda t: xp.array([1.0 / (t - 0.3001)])

    one = np.ones((1, 1))
    circuit = Case(
        name="circuit",
        problem=LCS(-one, one, one, one, u=u),
        x0=np.array([1.0]),
        t=np.linspace(0, 1, 4),
    )
    run = RunView(circuit, solvers.solve(circuit, "theta", h=3.7e-4))
    assert check_drift_pole(run) is not None


def _still(xp):
    return lambda t, x: xp.array([0.0 * x[0]])


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("spec, h", (("pbd", 1e-3), ("pbd[sweeps=3]", 1e-3), ("penalty", None)))
def test_walls_that_cross_and_part_between_two_samples(spec, h):
    """low = -1 + 3 t (1 - t) is above high = 1 - 3 t (1 - t) from t = 0.39 to 0.61; the samples are
    0 and 1."""

    def walls(xp):
        return lambda t: xp.array(
            [1.0 - 3.5 * 2.0 * t * (1.0 - t) * 0.6, 1.0 - 3.5 * 2.0 * t * (1.0 - t) * 0.6]
        )

    case = Case(
        name="crossing",
        problem=Complementarity(_still, (Affine(np.array([[1.0], [-1.0]]), walls),)),
        x0=np.array([0.1]),
        t=np.array([0.0, 1.0]),
    )
    status = solvers.solve(case, spec, **({"h": h} if h else {"k": 1e4})).status
    assert status.code == "infeasible" and "contradict" in str(status)
    narrow = case.replace(
        problem=Complementarity(
            _still,
            (Affine(np.array([[1.0], [-1.0]]), lambda xp: lambda t: 0.9 * walls(xp)(t) + 0.1),),
        )
    )  # they come as near as 0.055 and part again
    assert solvers.solve(narrow, spec, **({"h": h} if h else {"k": 1e4})).status.ok


def test_hard_particles_on_a_line_keep_their_order():
    """Ten times too fast for the step: without room to the side one jumps over the other."""

    def drift(xp):
        return lambda t, x: xp.array([5.0 + 0.0 * x[0], -5.0 + 0.0 * x[0]])

    case = Case(
        name="line",
        problem=Complementarity(drift, (Distance(d=0.1, dim=1),)),
        x0=np.array([-0.5, 0.5]),
        t=np.linspace(0.0, 1.0, 3),
    )
    assert solvers.solve(case, "pbd", h=1e-3).status.ok
    assert solvers.solve(case, "pbd", h=0.5).status.code == "unverified"
    anchored = case.replace(
        problem=Complementarity(
            drift, (Distance(d=0.1, dim=1, pairs=[[0, 0]], anchors=np.array([[0.0]])),)
        )
    )
    assert solvers.solve(anchored, "pbd", h=1e-3).status.ok
    assert solvers.solve(anchored, "pbd", h=0.5).status.code == "unverified"


def test_a_corner_is_told_where_it_is_held_and_not_where_it_is_passed():
    from nsbench import load_case

    kept = Path(__file__).parents[1] / "regressions"
    status = solvers.solve(
        load_case(kept / "many_velocities_in_a_corner.py"), "euler", h=1e-3
    ).status
    assert status.code == "unverified" and "corner" in str(status)
    assert solvers.solve(
        load_case(kept / "solution_beyond_a_surface.py"), "euler", h=1e-4
    ).status.ok


@pytest.mark.long
def test_a_narrow_peak_of_a_long_run_is_no_pole():
    case = _case(lambda xp, t, x: 1e-3 / ((t - 300.0) ** 2 + 1e-6), (0.0, 1000.0))
    assert solvers.solve(case, "euler", h=2e-3).status.ok


@pytest.mark.parametrize("times", ([0.0, np.pi], np.linspace(0.0, 2.0 * np.pi, 3)))
def test_a_vortex_has_no_pole_on_its_way(times):
    """Half a turn around the vortex: the straight way between the samples leads through its centre,
    the state does not."""

    def drift(xp):
        return lambda t, x: xp.array(
            [-x[1] / (x[0] ** 2 + x[1] ** 2), x[0] / (x[0] ** 2 + x[1] ** 2)]
        )

    case = Case(
        name="vortex", problem=Complementarity(drift), x0=np.array([1.0, 0.0]), t=np.array(times)
    )
    assert solvers.solve(case, "event_driven", tol=1e-10).status.ok


def test_poles_of_inputs_do_not_cancel_each_other():
    def u(xp):
        return lambda t: xp.array([1.0 / (t - 0.3001), -1.0 / (t - 0.3001)])

    two = np.eye(2)
    case = Case(
        name="inputs",
        problem=LCS(-two, two, two, two, u=u),
        x0=np.ones(2),
        t=np.linspace(0.0, 1.0, 4),
    )
    assert solvers.solve(case, "theta", h=3.7e-4).status.code == "diverged"


@pytest.mark.parametrize("sign, code", ((1.0, "ok"), (-1.0, "diverged")))
def test_an_open_row_may_open_without_bound(sign, code):
    """w = x + lam + q: a q that goes to + infinity leaves lam = 0, one that goes to - infinity
    takes lam along."""

    def q(xp):
        return lambda t: xp.array([sign * 1e-6 / (t - 0.3001) ** 2])

    one = np.ones((1, 1))
    case = Case(
        name="opens",
        problem=LCS(-one, one, one, one, q=q),
        x0=np.array([1.0]),
        t=np.linspace(0.0, 1.0, 4),
    )
    assert solvers.solve(case, "theta", h=3.7e-4).status.code == code


def test_a_way_back_to_a_surface_is_no_stay():
    """x' = y + s / 2, y' = -3 from (0, 1): the arc ends on x = 0 again, and between its ends both
    fields leave the surface."""
    case = relays(
        lambda xp: lambda t, x, s: xp.array([x[1] + 0.5 * s[0], -3.0 + 0.0 * x[0]]),
        lambda xp: lambda t, x: xp.array([x[0]]),
        [0.0, 1.0],
        [0.0, 1.0, 1.3],
    )
    assert solvers.solve(case, "event_driven", tol=1e-10).status.ok


@pytest.mark.compiled
@pytest.mark.parametrize("spec", ("euler", "euler[implicit=true]"))
def test_functions_that_raise_where_the_run_never_was_and_lists(spec):
    case = relays(
        lambda xp: lambda t, x, s: [-s[0] + 0.5 * math.cos(t), 1.0],
        lambda xp: lambda t, x: [x[0] - 0.1 * math.sqrt(1.0 + x[1]), 1.0 + math.log(x[1])],
        [0.3, 0.4],
        [0.0, 2.0],
    )
    assert solvers.solve(case, spec, h=1e-2).status.ok


def test_a_corner_is_passed_however_many_samples_and_held_however_many():
    from nsbench import load_case

    passing = relays(
        lambda xp: lambda t, x, s: xp.array([1.0 + 0.2 * s[0] * s[1], 1.0 + 0.2 * s[0] * s[1]]),
        lambda xp: lambda t, x: xp.array([x[0], x[1]]),
        [-0.5003, -0.5001],
        np.linspace(0.0, 1.0, 251),
    )
    assert solvers.solve(passing, "euler", h=1e-3).status.ok
    held = load_case(Path(__file__).parents[1] / "regressions" / "many_velocities_in_a_corner.py")
    every = held.replace(t=np.linspace(held.t[0], held.t[-1], 1001), exact=None, exact_impulse=None)
    assert (
        solvers.solve(every, "euler", h=(held.t[-1] - held.t[0]) / 1000).status.code == "unverified"
    )


def test_doubts_evaluate_a_field_about_as_often_as_a_run():
    """Twelve relays with hundreds of modes, thirty removable singularities: neither all modes at
    all times nor all corners."""
    calls = [0]

    def counted(f):
        def called(*args):
            calls[0] += 1
            return f(*args)

        return called

    d = 12
    times = np.linspace(0.0, 6.0, 200)
    twelve = relays(
        lambda xp: counted(
            lambda t, x, s: xp.cos(t * xp.arange(1, 13)) - 0.5 * s / (2.0 + xp.sin(x))
        ),
        lambda xp: lambda t, x: 1.0 * x,
        np.linspace(-0.1, 0.1, d),
        times,
    )
    assert solvers.solve(twelve, "euler", h=1e-2).status.ok and calls[0] < 10_000
    many = Case(
        name="many",
        problem=Complementarity(
            lambda xp: counted(lambda t, x: xp.cos(7.0 * t) + 0.01 * xp.sin(x) / x)
        ),
        x0=np.linspace(-0.1, 0.1, 30) + 0.0123,
        t=times,
    )
    calls[0] = 0
    assert solvers.solve(many, "euler", h=1e-2).status.ok and calls[0] < 10_000
