"""Walls and links that leave no point, in any unit and anywhere, are told; what only looks like it
is not."""

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, Smooth, solvers
from nsbench.diagnostics.contacts.infeasible_constraints import contradiction


def _rest(xp):
    return lambda t, x: 0.0 * x


def _still(xp):
    return lambda t, x: xp.array([0.0 * x[0]])


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("gap, code", ((1e-8, "infeasible"), (1e-12, "ok")))
def test_walls_that_miss_each_other_by_little(gap, code):
    """x <= 0.5 and x >= 0.5 + gap, in rows of very different size: rounding aside, no state meets
    both."""
    walls = Affine(np.array([[-1.0], [1e6]]), np.array([0.5, -1e6 * (0.5 + gap)]))
    case = Case(
        name="gap",
        problem=Complementarity(_still, (walls,)),
        x0=np.array([0.5]),
        t=np.linspace(0, 1, 3),
        start="keep",
    )
    assert solvers.solve(case, "pbd", h=0.01).status.code == code


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("size", (1e-6, 1.0, 1e6))
def test_the_unit_of_a_scene_is_not_that_of_its_rows(size):
    """x >= 1.05e-8 and x <= 1e-8, and a start within the first by a twentieth, in rows of any
    size."""
    walls = Affine(size * np.array([[1.0], [-1.0]]), size * np.array([-1.05e-8, 1e-8]))
    case = Case(
        name="rows",
        problem=Complementarity(_still, (walls,)),
        x0=np.array([1e-8]),
        t=np.linspace(0, 1, 3),
        start="keep",
    )
    assert solvers.solve(case, "pbd", h=0.01).status.code == "infeasible"
    one = Complementarity(_still, (Affine(np.array([[size]]), np.array([-1.05e-8 * size])),))
    with pytest.raises(ValueError, match="violates"):
        solvers.solve(case.replace(problem=one, start="error"), "pbd", h=0.01)


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("length, origin", ((1.0, 0.0), (1e-8, 0.0), (1.0, 1e8)))
def test_walls_cross_in_any_unit_and_anywhere(length, origin):
    """x >= t / 10 and x <= -t / 20 in lengths, seen from an origin; apart again, they leave
    room."""

    def case(rate):
        def b(xp):
            return lambda t: xp.array([length * (-0.1 * t) - origin, length * (rate * t) + origin])

        walls = Affine(np.array([[1.0], [-1.0]]), b)
        return Case(
            name="cross",
            problem=Complementarity(_still, (walls,)),
            x0=np.array([origin]),
            t=np.linspace(0, 1, 4),
        )

    assert solvers.solve(case(-0.05), "pbd", h=0.01).status.code == "infeasible"
    assert solvers.solve(case(0.15), "pbd", h=0.01).status.ok


@pytest.mark.survives("empty set")
def test_several_links_of_one_pair_hold_as_the_shortest():
    """Links of 3 and 1 between two particles that are held 2.5 apart: together they do not let go
    of 4."""

    def made(apart):
        links = (
            Distance(3.0, -1, pairs=[[0, 1]], dim=1),
            Distance(1.0, -1, pairs=[[0, 1]], dim=1),
            Distance(0.5, -1, pairs=[[0, 0], [1, 1]], anchors=np.array([[0.0], [apart]]), dim=1),
        )
        return Case(
            name="twice",
            problem=Complementarity(_rest, links),
            x0=np.array([0.0, 1.0]),
            t=np.linspace(0, 1, 3),
            start="keep",
        )

    assert (
        solvers.solve(made(1.9), "pbd", h=0.01).status.ok and contradiction(made(1.9), 0.0) is None
    )
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
    case = Case(
        name="third",
        problem=Complementarity(_still, (walls,)),
        x0=np.array([0.2]),
        t=np.linspace(0, 1, samples),
    )
    assert solvers.solve(case, "pbd", h=0.01).status.code == "infeasible"
    assert solvers.solve(case.replace(t=np.linspace(0, 0.4, samples)), "pbd", h=0.01).status.ok


@pytest.mark.survives("empty set")
def test_links_of_several_dimensions_are_chains_of_their_own():
    """Two particles in the plane on links to moving anchors, 5 apart, and a link between their
    abscissas alone: no chain."""

    def ends(xp):
        return lambda t: xp.array([[0.1 * t, 0.0], [0.0, 5.0]])

    def line(xp):
        return lambda t: xp.array([[0.2 * t]])

    two = Distance(1.0, -1, pairs=[[0, 0], [1, 1]], anchors=ends, dim=2)
    others = (
        Distance(0.1, -1, pairs=[[0, 2]], dim=1),
        Distance(1.0, -1, pairs=[[0, 0]], anchors=line, dim=1),
        Distance(1.0, -1, pairs=np.empty((0, 2), int), anchors=line, dim=1),
    )
    for more in others:
        case = Case(
            name="mixed",
            problem=Complementarity(_rest, (two, more)),
            x0=np.array([0.0, 0.5, 0.0, 4.5]),
            t=np.linspace(0, 1, 3),
        )
        assert solvers.solve(case, "pbd", h=0.01).status.ok


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("samples", (201, 301))
def test_a_deeper_violation_elsewhere_hides_no_contradiction(samples):
    """Walls that cross by 0.1 at t = 1/2; at t = 1/5 a floor is pushed down by 0.2."""

    def b(xp):
        return lambda t: xp.array(
            [0.1 - 0.2 * xp.sin(np.pi * t) ** 2, 0.1 - 0.2 * xp.sin(np.pi * t) ** 2, 0.0 * t]
        )

    def push(xp):
        return lambda t, x: xp.array([0.0 * t, -200.0 * xp.exp(-(((t - 0.2) / 0.05) ** 2))])

    walls = Affine(np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]]), b)
    case = Case(
        name="hidden",
        problem=Complementarity(push, (walls,)),
        x0=np.zeros(2),
        t=np.linspace(0, 1, samples),
    )
    assert solvers.solve(case, "penalty", k=1000.0).status.code == "infeasible"
    assert solvers.solve(case.replace(t=case.t * 0.24), "penalty", k=1000.0).status.ok


@pytest.mark.survives("empty set")
def test_discs_without_room_beside_a_deeper_overlap():
    """A disc squeezed between moving walls by 0.05 at the end, while an earlier push drives another
    through its floor by 0.2."""

    def b(xp):
        return lambda t: xp.array([0.5 + 0.0 * t, 1.05 - 0.1 * t, 0.0 * t])

    def push(xp):
        return lambda t, x: xp.array([0.0, 0.0, -200.0 * xp.exp(-(((t - 0.2) / 0.05) ** 2))])

    walls = Affine(np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]), b)
    two = Distance(1.5, dim=1, count=2)
    case = Case(
        name="squeezed",
        problem=Complementarity(push, (two, walls)),
        x0=np.array([-0.48, 1.03, 0.0]),
        t=np.linspace(0, 1, 301),
    )
    assert solvers.solve(case, "penalty", k=1000.0).status.code == "infeasible"
    assert solvers.solve(case.replace(t=case.t * 0.3), "penalty", k=1000.0).status.ok


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("far", (1.0, 1e9))
def test_what_is_far_away_excuses_no_contradiction_here(far):
    """Links too short, walls that cross, by 0.005; another particle is at `far`."""

    def anchors(xp):
        return lambda t: xp.array([[0.0 * t], [1.9 + 0.105 * t], [far + 0.0 * t]])

    def b(xp):
        return lambda t: xp.array([-0.505 * t, 0.5 + 0.0 * t, -far + 0.0 * t])

    links = Distance(1.0, -1, pairs=[[0, 0], [0, 1], [1, 2]], anchors=anchors, dim=1)
    walls = Affine(np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]]), b)
    for held, x in ((links, 0.95), (walls, 0.2)):
        case = Case(
            name="far",
            problem=Complementarity(_rest, (held,)),
            x0=np.array([x, far]),
            t=np.linspace(0, 1, 3),
        )
        assert solvers.solve(case, "pbd", h=0.01).status.code == "infeasible"
        assert solvers.solve(case.replace(t=case.t * 0.9), "pbd", h=0.01).status.ok


@pytest.mark.survives("empty set")
@pytest.mark.parametrize("slope", (1e-5, 1e-7))
def test_a_flat_wedge_is_closed_by_a_wall_far_away(slope):
    """y >= 0 and y <= slope (x - 10 t) leave room beyond x = 10 t, which x <= 1 takes."""

    def b(xp):
        return lambda t: xp.array([0.0 * t, -10.0 * slope * t, 1.0 + 0.0 * t])

    walls = Affine(np.array([[0.0, 1.0], [slope, -1.0], [-1.0, 0.0]]), b)
    case = Case(
        name="wedge",
        problem=Complementarity(_rest, (walls,)),
        x0=np.zeros(2),
        t=np.linspace(0, 1, 3),
    )
    assert solvers.solve(case, "pbd", h=0.01).status.code == "infeasible"
    assert contradiction(case, 0.09) is None and contradiction(case, 0.11)


@pytest.mark.survives("empty set")
def test_every_chain_is_looked_at_between_samples():
    """Two links of 1 between anchors that part to 2.3 and meet again; 201 particles on links of
    their own."""
    ends = np.append(5.0 * np.arange(201), [-50.0, 0.0])[:, None]
    last = np.eye(1, 203, 202).T

    def anchors(xp):
        return lambda t: xp.asarray(ends) + xp.asarray(last) * (-48.1 + 1.6 * t * (1.0 - t))

    links = Distance(
        1.0,
        -1,
        pairs=[[i, i] for i in range(201)] + [[201, 201], [201, 202]],
        anchors=anchors,
        dim=1,
    )
    case = Case(
        name="chains",
        problem=Complementarity(_rest, (links,)),
        x0=np.append(5.0 * np.arange(201), -49.05),
        t=np.array([0.0, 1.0]),
    )
    assert solvers.solve(case, "pbd", h=0.01).status.code == "infeasible"


@pytest.mark.survives("empty set")
def test_a_heap_that_comes_apart_had_room():
    """Three discs thrown together in a square: to first order no way out, but the run finds one."""
    box = Affine(np.vstack([np.eye(6), -np.eye(6)]), np.repeat([0.0, 1.0], 6))
    case = Case(
        name="heap",
        problem=Complementarity(_rest, (box, Distance(0.9))),
        t=np.linspace(0, 1, 5),
        start="keep",
        x0=np.array([0.1, 0.45, 0.5, 0.55, 0.9, 0.45]),
    )
    assert solvers.solve(case, "pbd", h=0.005).status.ok


@pytest.mark.survives("empty set")
def test_two_roundings_of_one_wall_are_no_contradiction():
    """x = 2/3 + sin t, one side of it printed; a circle through the start, from both sides; PBD
    behind a prescribed motion."""

    def b(xp):
        return lambda t: xp.array([-0.6666666667 - xp.sin(t), 2.0 / 3.0 + xp.sin(t)])

    def moved(xp):
        return lambda t: xp.array([-xp.sin(t), xp.sin(t)])

    def circle(xp):
        def g(t, x):
            r2 = 0.56**2 + 0.96**2
            s2 = (x[0] - 0.56) ** 2 + (x[1] - 0.96) ** 2
            return xp.array([xp.sqrt(s2) - np.sqrt(r2), r2 - s2])

        return g

    both = np.array([[1.0], [-1.0]])
    behind = Affine(both, moved), [0.0], 901
    for held, x0, samples in (
        (Affine(both, b), [2.0 / 3.0], 11),
        (Smooth(circle), [0.0, 0.0], 3),
        behind,
    ):
        case = Case(
            name="one",
            problem=Complementarity(_rest, (held,)),
            x0=np.array(x0),
            t=np.linspace(0, 1, samples),
        )
        assert solvers.solve(case, "pbd", h=0.01).status.ok


@pytest.mark.long
@pytest.mark.survives("empty set")
def test_the_programs_of_a_run_are_counted(monkeypatch):
    """Walls without room ask for one at every sample, and still tell of the time at which they
    cross."""
    from nsbench.diagnostics.contacts import infeasible_rows

    asked = []
    plain = infeasible_rows._program
    monkeypatch.setattr(infeasible_rows, "_program", lambda *args: asked.append(1) or plain(*args))

    def b(cross):
        dip = lambda xp, t: cross * xp.maximum(0.0, 0.01 - xp.abs(t - 0.7))
        return lambda xp: lambda t: xp.array([-xp.sin(9.0 * t), xp.sin(9.0 * t) - dip(xp, t)])

    walls = lambda cross: Affine(np.array([[1.0], [-1.0]]), b(cross))
    for cross, code in ((0.0, "ok"), (1.0, "infeasible")):
        case = Case(
            name="many",
            problem=Complementarity(_still, (walls(cross),)),
            x0=np.array([0.0]),
            t=np.linspace(0, 1, 3001),
        )
        assert solvers.solve(case, "penalty", k=1000.0).status.code == code
        assert len(asked) <= 2 * (infeasible_rows.MOST + 1)


@pytest.mark.parametrize("aside, code", ((1e-6, "unverified"), (0.3, "ok")))
def test_a_squeezed_row_that_hardly_yields_is_told(aside, code):
    """Three discs between a wall and one that comes by 1e-6: from a straight row the middle one has
    to leave by about 1e-3."""
    c = np.sqrt(1.0 - aside**2)

    def b(xp):
        return lambda t: xp.array([0.0 * t, 2.0 * c - t])

    walls = Affine(np.array([[1.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, -1.0, 0]]), b)
    case = Case(
        name="squeezed",
        problem=Complementarity(_rest, (Distance(1.0), walls)),
        x0=np.array([0.0, 0.0, c, aside, 2.0 * c, 0.0]),
        t=np.linspace(0.0, 1e-6, 6),
    )
    status = solvers.solve(case, "pbd", h=1e-8).status
    assert status.code == code and (code == "ok" or "farther away" in str(status))
    run = solvers.solve(case, "catching_up", h=1e-10)
    assert run.status.ok and run.x[-1, 3] - run.x[-1, 1] == pytest.approx(
        np.sqrt(1.0 - (c - 5e-7) ** 2), rel=1e-3
    )


def test_a_gradient_that_is_infinite_is_no_crash():
    """y >= sqrt(x) at x = 0, beside two rows that a sweep does not meet at once."""

    def gradient(xp):
        return lambda t, x: xp.stack(
            [xp.stack([-0.5 / xp.sqrt(x[0]), 1.0 + 0.0 * x[0], 0.0 * x[0], 0.0 * x[0]])]
        )

    root = Smooth(lambda xp: lambda t, x: xp.stack([x[1] - xp.sqrt(x[0])]), gradient=gradient)
    rows = Affine(np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 1.0]]), np.zeros(2))
    drift = lambda xp: (
        lambda t, x: xp.stack([0.0 * x[0], 0.0 * x[0], -1.0 + 0.0 * x[0], -3.0 + 0.0 * x[0]])
    )
    case = Case(
        name="root",
        problem=Complementarity(drift, (rows, root)),
        x0=np.array([0.0, 1.0, 1.0, 1.0]),
        t=np.linspace(0.0, 2.0, 5),
    )
    with np.errstate(all="ignore"):
        assert solvers.solve(case, "pbd", h=1e-2).status.code in ("ok", "unverified")
