"""PBD in JAX does the coloured sweep of the compiled loop, and refuses what it cannot do."""

import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, Smooth, get_case, solve
from nsbench.dynamics.contacts.constraint_set import PAIR, ConstraintSet
from nsbench.solvers import get
from nsbench.solvers.common.hard_particles import hard_particles
from nsbench.solvers.pbd_jax.program import arrange


def same(case, h, options="", tolerance=1e-12):
    extra = f",{options}" if options else ""
    a = solve(case, f"pbd[order=coloured{extra}]", h=h)
    b = solve(case, f"pbd_jax[device=cpu{extra}]", h=h)
    assert a.status.code == b.status.code and a.stats["steps"] == b.stats["steps"]
    assert (
        abs(a.stats["projections"] - b.stats["projections"]) <= 1e-3 * a.stats["projections"]
    )  # gaps of rounding
    for u, v in ((a.x, b.x), (a.reaction, b.reaction)):
        assert np.abs(u - v).max() < tolerance
    one, two = ({c: t.impulse[:, m] for m, c in enumerate(t.contacts)} for t in (a, b))
    assert all(np.abs(one.get(c, 0.0) - two.get(c, 0.0)).max() < tolerance for c in {*one, *two})
    return a, b


@pytest.mark.long
def test_a_hundred_steps_of_a_full_box():
    case = get_case("discs", n=1000, box=True)
    case = case.replace(t=np.linspace(0.0, 1.0, 3))
    b = same(case, 1e-2)[1]
    assert b.stats["steps"] == 100 and len(b.contacts) > 1000 and b.stats["rebuilds"] > 0


@pytest.mark.long
@pytest.mark.parametrize("options", ["sweeps=2,seed=7", "reach=0.01"])
def test_options_are_those_of_the_compiled_loop(options):
    case = get_case("discs", n=30)
    same(case.replace(t=case.t[:5]), 1e-2, options, 1e-11)


@pytest.mark.long
def test_links_rows_and_families():
    """Discs of several sizes between a link and a slanted moving wall over two particles and a
    coordinate of its own."""
    rng = np.random.default_rng(4)
    x0 = np.concatenate(
        [3.0 * np.stack(np.divmod(np.arange(9), 3), 1).ravel() + 0.3 * rng.random(18), [0.0]]
    )
    rows = np.zeros((2, 19))
    rows[0, [0, 5]] = (1.0, 0.5)
    rows[1, [3, 18]] = (-0.3, -1.0)
    wall = Affine(rows, lambda xp: lambda t: xp.stack([1.0 - t, 1.2 + xp.sin(t)]))
    problem = Complementarity(
        lambda xp: lambda t, x: -x + xp.cos(t),
        (
            Distance(radii=np.linspace(0.6, 1.1, 9), count=9),
            wall,
            Distance(9.0, sign=-1, pairs=[[0, 8], [1, 2]], count=9),
            Distance(0.4, pairs=[[0, 1]], count=9),
        ),
    )
    case = Case("mixed", problem, x0, np.linspace(0.0, 2.0, 6))
    a, _ = same(case, 0.02)
    assert {c[0] for c in a.contacts} >= {0, 1}


def test_levels_keep_the_order_and_share_no_particle():
    case = get_case("discs", n=300, box=True)
    scene = ConstraintSet(case.problem, case.n)
    near = scene.near(case.x0, 0.3)
    rng = np.random.default_rng(2)
    near = near.take(rng.permutation(len(near)))
    levels, sizes = arrange(near.arrays(), scene, hard_particles(scene).owner, (0, 0, 0))
    where = np.full(len(near), -1)
    for number in (levels.pairs[4], levels.rows[3]):
        lev, _ = np.nonzero(number < len(near))
        where[number[number < len(near)]] = lev
    assert where.min() == 0 and where.max() == levels.count - 1 < sizes[0]
    last = {}
    for c in range(len(near)):  # each thing's constraints meet it in the order of the sweep
        on = (
            [near.p[c], near.q[c]]
            if near.kind[c] == PAIR
            else [scene.cols[scene.ptr[near.p[c]]] // 2 * 2]
        )
        for e in on:
            assert where[c] > last.get(int(e), -1)
            last[int(e)] = where[c]


@pytest.mark.long
def test_failures_and_refusals():
    import jax

    wild = Case(
        "wild",
        Complementarity(lambda xp: lambda t, x: xp.exp(x * x), (Distance(1.0),)),
        np.array([5.0, 0.0, 9.0, 0.0]),
        np.linspace(0, 2, 11),
    )
    with np.errstate(all="ignore"):
        traj = solve(wild, "pbd_jax[device=cpu]", h=0.1)
    assert (
        traj.status.code == "diverged"
        and traj.status.why == solve(wild, "pbd[order=coloured]", h=0.1).status.why
    )
    tied = Case(
        "tied",
        Complementarity(lambda xp: lambda t, x: 0.0 * x, (Distance(2.0),)),
        np.zeros(4),
        np.linspace(0, 1, 3),
        start="keep",
    )
    traj = solve(tied, "pbd_jax[device=cpu]", h=0.1)
    assert traj.status.code == "degenerate" and np.allclose(traj.x[-1], [1, 0, -1, 0])
    if not any(d.platform == "gpu" for d in jax.devices()):
        assert "GPU" in get("pbd_jax[device=gpu]").refuses(get_case("discs", n=3))
    assert "Filippov" in get("pbd_jax").refuses(get_case("sliding"))
    curved = get_case("tide").replace(
        problem=Complementarity(
            get_case("tide").problem.drift, (Smooth(lambda xp: lambda t, x: x),)
        )
    )
    assert "use pbd" in get("pbd_jax").refuses(curved)
    for option in ("device=tpu", "sweeps=0", "seed=-1", "reach=0"):
        with pytest.raises(ValueError, match=option.split("=")[0]):
            get(f"pbd_jax[{option}]")
