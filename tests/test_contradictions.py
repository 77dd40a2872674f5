"""Walls and links that leave no point, in any unit and anywhere, are told; what only looks like it is not."""
import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, solvers
from nsbench.solvers._contradiction import contradiction


def _rest(xp):
    return lambda t, x: 0.0 * x


def _still(xp):
    return lambda t, x: xp.array([0.0 * x[0]])


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("gap, code", ((1e-8, "infeasible"), (1e-12, "ok")))
def test_walls_that_miss_each_other_by_little(gap, code):
    """x <= 0.5 and x >= 0.5 + gap, in rows of very different size: rounding aside, no state meets both."""
    walls = Affine(np.array([[-1.0], [1e6]]), np.array([0.5, -1e6 * (0.5 + gap)]))
    case = Case(name="gap", problem=Complementarity(_still, (walls,)), x0=np.array([0.5]), t=np.linspace(0, 1, 3), start="keep")
    assert solvers.solve(case, "pbd", h=0.01).status.code == code


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("length, origin", ((1.0, 0.0), (1e-8, 0.0), (1.0, 1e8)))
def test_walls_cross_in_any_unit_and_anywhere(length, origin):
    """x >= t / 10 and x <= -t / 20 in lengths, seen from an origin; apart again, they leave room."""
    def case(rate):
        def b(xp):
            return lambda t: xp.array([length * (-0.1 * t) - origin, length * (rate * t) + origin])
        walls = Affine(np.array([[1.0], [-1.0]]), b)
        return Case(name="cross", problem=Complementarity(_still, (walls,)), x0=np.array([origin]), t=np.linspace(0, 1, 4))
    assert solvers.solve(case(-0.05), "pbd", h=0.01).status.code == "infeasible"
    assert solvers.solve(case(0.15), "pbd", h=0.01).status.ok


@pytest.mark.survives("empty set")
def test_several_links_of_one_pair_hold_as_the_shortest():
    """Links of 3 and 1 between two particles that are held 2.5 apart: together they do not let go of 4."""
    def made(apart):
        links = (Distance(3.0, -1, pairs=[[0, 1]], dim=1), Distance(1.0, -1, pairs=[[0, 1]], dim=1),
                 Distance(0.5, -1, pairs=[[0, 0], [1, 1]], anchors=np.array([[0.0], [apart]]), dim=1))
        return Case(name="twice", problem=Complementarity(_rest, links), x0=np.array([0.0, 1.0]), t=np.linspace(0, 1, 3),
                    start="keep")
    assert solvers.solve(made(1.9), "pbd", h=0.01).status.ok and contradiction(made(1.9), 0.0) is None
    assert "too short" in contradiction(made(2.5), 0.0)
    assert solvers.solve(made(2.5), "pbd", h=0.01).status.code == "infeasible"


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("third", (1e9, np.inf))
@pytest.mark.parametrize("samples", (4, 1000))
def test_a_wall_far_away_hides_no_contradiction(third, samples):
    """x >= t and x <= 0.5, and a wall that nothing reaches."""
    def b(xp):
        return lambda t: xp.array([-t, 0.5 + 0.0 * t, third + 0.0 * t])
    walls = Affine(np.array([[1.0], [-1.0], [-1.0]]), b)
    case = Case(name="third", problem=Complementarity(_still, (walls,)), x0=np.array([0.2]), t=np.linspace(0, 1, samples))
    assert solvers.solve(case, "pbd", h=0.01).status.code == "infeasible"
    assert solvers.solve(case.replace(t=np.linspace(0, 0.4, samples)), "pbd", h=0.01).status.ok


@pytest.mark.survives("empty set")
def test_links_of_several_dimensions_are_chains_of_their_own():
    """Two particles in the plane on links to moving anchors, 5 apart, and a link between their abscissas alone: no chain."""
    def ends(xp):
        return lambda t: xp.array([[0.1 * t, 0.0], [0.0, 5.0]])

    def line(xp):
        return lambda t: xp.array([[0.2 * t]])
    two = Distance(1.0, -1, pairs=[[0, 0], [1, 1]], anchors=ends, dim=2)
    others = (Distance(0.1, -1, pairs=[[0, 2]], dim=1), Distance(1.0, -1, pairs=[[0, 0]], anchors=line, dim=1),
              Distance(1.0, -1, pairs=np.empty((0, 2), int), anchors=line, dim=1))
    for more in others:
        case = Case(name="mixed", problem=Complementarity(_rest, (two, more)), x0=np.array([0.0, 0.5, 0.0, 4.5]),
                    t=np.linspace(0, 1, 3))
        assert solvers.solve(case, "pbd", h=0.01).status.ok
