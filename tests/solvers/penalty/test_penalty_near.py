"""A penalty over near pairs is the penalty over all pairs, and makes scenes possible that have too
many."""

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, get_case, solve
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers import get
from nsbench.solvers.penalty.neighbor_segments import NeighborSegments, _table


@pytest.mark.long
@pytest.mark.parametrize("reach", [0.05, 0.3])
def test_near_pairs_give_the_result_of_all_pairs(reach):
    case = get_case("discs", n=30)
    whole = solve(case, "penalty[pairs=all]", k=300.0)
    near = solve(case, f"penalty[pairs=near,reach={reach}]", k=300.0)
    assert (
        whole.status.ok
        and near.status.ok
        and near.stats["segments"] > 5
        and near.contacts == whole.contacts
    )
    scale = np.abs(whole.impulse).max()
    assert np.abs(near.x - whole.x).max() < 1e-6  # tolerance 1e-9; other sums, other steps
    assert np.abs(near.impulse - whole.impulse).max() < 1e-5 * scale
    assert np.abs(near.reaction - whole.reaction).max() < 1e-5 * scale


def mixed():
    """Discs of several sizes that close up, a second family on a line among other coordinates,
    walls, a link."""
    rng = np.random.default_rng(4)
    n = 9
    m = 6
    x0 = np.concatenate(
        [
            3.0 * np.stack(np.divmod(np.arange(n), 3), 1).ravel() + 0.3 * rng.random(2 * n),
            2.5 * np.arange(m),
            [0.0],
        ]
    )

    def drift(xp):
        return lambda t, x: -1.0 * x + xp.sin(t)

    floor = np.zeros((1, x0.size))
    floor[0, -1] = -1.0
    return Case(
        "mixed",
        Complementarity(
            drift,
            (
                Distance(radii=np.linspace(0.6, 1.1, n), count=n),
                Affine(floor, np.array([0.2])),
                Distance(1.0, dim=1, start=2 * n, count=m),
                Distance(9.0, sign=-1, pairs=[[0, 8]], count=n),
            ),
        ),
        x0,
        np.linspace(0, 2, 21),
    )


@pytest.mark.long
def test_several_families_and_listed_constraints():
    case = mixed()
    whole, near = (solve(case, f"penalty[pairs={p}]", k=200.0) for p in ("all", "near"))
    assert (
        near.status.ok
        and near.contacts == whole.contacts
        and len({c[0] for c in near.contacts}) >= 3
    )
    assert (
        np.abs(near.x - whole.x).max() < 1e-6 and np.abs(near.impulse - whole.impulse).max() < 1e-5
    )
    assert np.abs(near.reaction - whole.reaction).max() < 1e-5
    assert (
        np.abs(near.x - case.x0 - near.reaction - (whole.x - case.x0 - whole.reaction)).max() < 1e-6
    )


@pytest.mark.long
@pytest.mark.parametrize("method", ["tsit5", "kvaerno3"])
def test_a_right_hand_side_beyond_the_lists_is_refused(method):
    """Two discs meet head on, far from where they were listed: with lists for ever they would pass
    through each other."""
    problem = Complementarity(
        lambda xp: lambda t, x: xp.array([1.0, 0.0, -1.0, 0.0]) + 0.0 * x, (Distance(2.0),)
    )
    case = Case("meet", problem, np.array([-30.0, 0.0, 30.0, 0.0]), np.linspace(0.0, 40.0, 5))
    traj = solve(case, f"penalty[pairs=near,method={method}]", k=100.0)
    assert traj.status.ok and traj.contacts == ((0, 0, 1),)
    assert np.allclose(
        traj.x[-1, 2] - traj.x[-1, 0], 2.0 - 1.0 / 100.0, atol=1e-6
    )  # 1 = k depth pushes each back
    assert traj.stats["segments"] > 100


def test_tables_list_each_pair_twice_and_nothing_else():
    case = get_case("discs", n=30)
    seg = NeighborSegments(case, case.x0, "tsit5", 0.3)
    (table,) = seg._lists(case.x0)
    near = ConstraintSet(case.problem, case.n).near(case.x0, seg.margin)
    found = {(i, int(j)) for i in range(30) for j in table[i] if j != i}
    assert found == {
        (a, b)
        for i, j in zip(near.i.tolist(), near.j.tolist(), strict=True)
        for a, b in ((i, j), (j, i))
    }
    assert _table(np.empty(0, np.int64), np.empty(0, np.int64), 2, 8).tolist() == [[0] * 8, [1] * 8]


@pytest.mark.survives("giant")
def test_many_discs_and_what_is_still_refused():
    case = get_case("discs", n=300)
    case = case.replace(t=np.linspace(0.0, 0.2, 5))
    traj = solve(case, "penalty", k=100.0)
    assert (
        traj.status.ok and len(traj.contacts) > 50 and traj.impulse.shape == (5, len(traj.contacts))
    )
    assert np.abs(traj.x[-1] - case.x0).max() > 0.1
    forces = ConstraintSet(case.problem, case.n)
    near = forces.near(traj.x[-1], 0.0)
    assert set(near.ids) <= set(traj.contacts)  # whoever overlaps at the end pushes
    assert "44850" in get("penalty[pairs=all]").refuses(case)
    assert "GB" in get("penalty").refuses(
        get_case("discs", n=20000).replace(t=np.linspace(0.0, 1.0, 401))
    )
