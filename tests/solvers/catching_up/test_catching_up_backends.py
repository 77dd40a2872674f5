"""Catching up is one method, whoever solves its QPs and whichever loop it runs in; false answers
are noticed."""

import dataclasses

import numpy as np
import pytest
from scipy.sparse import eye_array

import nsbench
from nsbench import Affine, Case, Complementarity, Distance
from nsbench.solvers.base import grid
from nsbench.solvers.catching_up import qp_backends

ACCURATE = ("catching_up", "catching_up[backend=osqp]", "catching_up[backend=piqp]")


def still(xp):
    def f(t, x):
        return 0.0 * x

    return f


def host_twin(case, h, reach=0.3):
    """The run of the active set in the Python loop."""
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.solvers.catching_up.host_loop import HostLoop
    from nsbench.compilation.case_functions import in_python
    from nsbench.solvers.catching_up.method import _trajectory

    g = grid(case.t, h)
    loop = HostLoop(
        case,
        ConstraintSet(case.problem, case.n),
        g,
        case.x0.copy(),
        "active_set",
        False,
        reach,
        None,
        None,
    )
    return _trajectory(case, g, in_python("asked for"), loop.run(), None)


class Liar(qp_backends.ActiveSet):
    """Says solved, with multipliers a thousandth too large."""

    def __call__(self, *args):
        return dataclasses.replace(a, mu=1.001 * a.mu) if (a := super().__call__(*args)) else a


@pytest.mark.survives("false solution")
def test_a_backend_that_claims_success_falsely_is_unverified(monkeypatch):
    case = nsbench.get_case("tide")
    monkeypatch.setitem(qp_backends.BACKENDS, "osqp", Liar)
    run = nsbench.solve(case, "catching_up[backend=osqp]", h=0.05)
    assert (
        run.status.code == "unverified"
        and "KKT residual" in str(run.status)
        and run.stats["kkt"] > 1e-6
    )


@pytest.mark.survives("iteration limit")
def test_an_iteration_limit_is_counted_and_shown():
    run = nsbench.solve("discs[n=3]", "catching_up[backend=osqp,max_iter=1]", h=0.05)
    assert run.stats["limits"] > 5 and run.status.code == "unverified"


def test_backends_and_loops_agree_on_multipliers():
    case = nsbench.get_case("three_discs")
    own = nsbench.solve(case, "catching_up", h=0.02)
    twin = host_twin(case, 0.02)
    assert own.stats["loop"] == "compiled" and twin.stats["loop"] == "host"
    assert own.contacts == twin.contacts and own.status.ok
    assert twin.x == pytest.approx(own.x, abs=1e-12) and twin.impulse == pytest.approx(
        own.impulse, abs=1e-11
    )
    for spec in ACCURATE[1:]:
        other = nsbench.solve(case, spec, h=0.02)
        at = [other.contacts.index(c) for c in own.contacts]
        assert other.x == pytest.approx(own.x, abs=1e-8)
        assert other.impulse[:, at] == pytest.approx(own.impulse, abs=1e-6)
        assert own.impulse[-1].max() > 0.1


def everything():
    """Discs, moving walls, links, a moving anchor: every kind of constraint at once."""
    rng = np.random.default_rng(3)
    x0 = 2.2 * np.stack(np.divmod(np.arange(9), 3), 1).ravel() + rng.uniform(-0.05, 0.05, 18)
    eye = np.eye(18)

    def walls(xp):
        def b(t):
            return xp.concatenate((xp.full(18, 0.3) + 0.2 * xp.sin(t), xp.full(18, 4.8) - 0.3 * t))

        return b

    def hook(xp):
        def a(t):
            return xp.array([[1.0, 0.0]]) * xp.cos(t) + xp.array([[-2.0, 2.0]])

        return a

    def nail(xp):
        def a(t):
            return xp.array([[5.5, 0.0]]) * xp.cos(0.1 * t)

        return a

    def f(xp):
        def g(t, x):
            return xp.cos(3.0 * t) * (2.0 - x) + xp.sin(xp.arange(18.0) + t)

        return g

    families = (
        Distance(2.0),
        Affine(np.vstack([eye, -eye]), walls),
        Distance(2.1, sign=-1, pairs=[[0, 1], [4, 5]]),
        Distance(1.5, sign=-1, pairs=[[6, 0]], anchors=nail),
        Distance(1.0, anchors=hook),
    )
    return Case(
        "everything", Complementarity(f, families), x0, np.linspace(0.0, 1.0, 5), start="keep"
    )


@pytest.mark.long
def test_the_compiled_loop_is_the_loop_in_python_for_every_family():
    case = everything()
    own = nsbench.solve(case, "catching_up", h=0.01)
    twin = host_twin(case, 0.01)
    assert (
        own.status.ok
        and own.stats["loop"] == "compiled"
        and {c[0] for c in own.contacts} >= {0, 1, 2, 3}
    )
    assert own.contacts == twin.contacts
    assert twin.x == pytest.approx(own.x, abs=1e-11) and twin.impulse == pytest.approx(
        own.impulse, abs=1e-10
    )
    assert own.reaction == pytest.approx(twin.reaction, abs=1e-11)


@pytest.mark.long
@pytest.mark.parametrize("spec", ACCURATE)
def test_redundant_contacts_have_the_unique_reaction(spec):
    run = nsbench.solve("hex[n=19]", spec, h=0.01)
    case = nsbench.get_case("hex[n=19]")
    late = run.t > 0.5
    assert run.status.ok and len(run.contacts) >= 30
    fall = np.gradient(run.reaction[late], run.t[late], axis=0)[1:-1]
    assert fall == pytest.approx(np.broadcast_to(case.exact(run.t)[-1], fall.shape), abs=1e-6)
    both = nsbench.solve("duplicate", spec, h=0.01)
    assert both.status.ok and both.impulse.min() >= -1e-12


@pytest.mark.parametrize("spec", ACCURATE)
def test_contradicting_walls_are_infeasible_from_then_on(spec):
    def walls(xp):
        def b(t):
            return xp.stack((-t, 1.0 + 0.0 * t))  # t <= x <= 1

        return b

    case = Case(
        "press",
        Complementarity(still, (Affine(np.array([[1.0], [-1.0]]), walls),)),
        np.array([0.5]),
        np.linspace(0.0, 2.0, 5),
    )
    run = nsbench.solve(case, spec, h=0.1)
    assert run.status.code == "infeasible" and "t = 1" in str(run.status)
    assert (
        run.x[:3, 0] == pytest.approx([0.5, 0.5, 1.0])
        and np.all(np.isnan(run.x[3:]))
        and np.all(np.isnan(run.impulse[3:]))
    )


def test_bounds_that_osqp_takes_for_infinite_are_no_answer(capfd):
    backend = qp_backends.OSQP()
    G = qp_backends.SparseRows.of(eye_array(2).tocsr())
    key = object()
    start = np.zeros(2)
    assert backend(G, np.array([-1.0, 1.0]), 0.1, key, start).code == "solved"
    answer = backend(G, np.array([-1e32, 1.0]), 0.1, key, start)
    assert (
        answer.code == "maxiter"
        and not answer.d.any()
        and "ERROR" not in "".join(capfd.readouterr())
    )
    assert backend(G, np.array([-2.0, 1.0]), 0.1, key, start).d[0] == pytest.approx(2.0)


@pytest.mark.parametrize("backend", ["active_set", "osqp", "piqp"])
def test_the_unit_of_length_is_the_users(backend):
    def case(unit):
        def drift(xp):
            return lambda t, x: (
                unit
                * xp.array(
                    [
                        1.0 - 0.4 * x[0] / unit,
                        0.1 * xp.sin(t) - 0.4 * x[1] / unit,
                        -0.4 * x[2] / unit,
                        -0.4 * x[3] / unit,
                    ]
                )
            )

        return Case(
            "unit",
            Complementarity(drift, (Distance(d=unit, dim=2),)),
            unit * np.array([-1.0, 0.0, 0.0, 0.1]),
            np.linspace(0.0, 1.0, 6),
        )

    large, small = (
        nsbench.solve(case(unit), f"catching_up[backend={backend}]", h=0.02) for unit in (1.0, 1e-8)
    )
    assert large.status.ok and small.status.ok
    assert (
        np.abs(small.x / 1e-8 - large.x).max() < 1e-7
        and np.abs(small.impulse / 1e-8 - large.impulse).max() < 1e-7
    )
