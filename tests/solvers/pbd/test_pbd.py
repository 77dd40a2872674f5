"""Position-based dynamics is what it says: the stated sweep, bit for bit, however the pairs are
found."""

import itertools

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Smooth
from nsbench.solvers import get

RNG = np.random.default_rng(20)


def pull(xp):
    def f(t, x):
        return -x

    return f


def crowd(n, size, seed, walls=False):
    """n discs of radius 1 thrown into a box: they overlap."""
    x0 = np.random.default_rng(seed).uniform(1.0, size - 1.0, 2 * n)
    eye = np.eye(2 * n)
    family = (
        Distance(2.0),
        Affine(
            np.vstack([eye, -eye]),
            np.concatenate([np.full(2 * n, -1.0), np.full(2 * n, size - 1.0)]),
        ),
    )
    return Case(
        "crowd",
        Complementarity(pull, family if walls else family[:1]),
        x0,
        np.linspace(0.0, 0.3, 4),
        start="keep",
    )


def plain(case, h, sweeps, keys):
    """The method written down as in the paper: Euler, then projections over all constraints in the
    order of `keys`."""
    x = case.x0.copy()
    X = [case.x0.copy()]
    n = case.n // 2
    impulses = {}
    wall = case.problem.constraints[1] if len(case.problem.constraints) > 1 else None
    todo = [((0, i, j), None) for i, j in itertools.combinations(range(n), 2)]
    todo += [((1, r), None) for r in range(wall.shape[0] if wall else 0)]
    todo = [c for c, _ in sorted(todo, key=lambda c: keys(c[0]))]
    for a, b in itertools.pairwise(case.t):
        steps = round((b - a) / h)
        step = (b - a) / steps
        for _ in range(steps):
            x = x + step * -x
            for _ in range(sweeps):
                for c in todo:
                    if c[0] == 0:
                        i = 2 * c[1]
                        j = 2 * c[2]
                        dx = x[i] - x[j]
                        dy = x[i + 1] - x[j + 1]
                        s = dx * dx + dy * dy
                        if s >= 4.0:
                            continue
                        r = np.sqrt(s)
                        mu = -0.5 * (r - 2.0)
                        w = mu / r
                        for k, e in ((0, w * dx), (1, w * dy)):
                            x[i + k] += e
                            x[j + k] -= e
                    else:
                        row = slice(wall.indptr[c[1]], wall.indptr[c[1] + 1])
                        g = wall.b[c[1]] + wall.data[row][0] * x[wall.indices[row][0]]
                        if g >= 0.0:
                            continue
                        mu = -g
                        x[wall.indices[row][0]] += mu * wall.data[row][0]
                    impulses[c] = impulses.get(c, 0.0) + mu
        X.append(x.copy())
    return np.array(X), impulses


def test_is_the_sweep_over_all_pairs_written_down_plainly():
    for walls, order in itertools.product((False, True), ("sorted", "reverse")):
        case = crowd(30, 12.0, 1, walls)
        sign = 1 if order == "sorted" else -1
        X, impulses = plain(case, 0.05, 1, lambda c, sign=sign: tuple(sign * v for v in c))
        traj = nsbench.solve(case, f"pbd[order={order},reach=0.1]", h=0.05)
        assert np.array_equal(traj.x, X), f"{walls=} {order=}"
        assert set(traj.contacts) == set(impulses)
        assert np.allclose(traj.impulse[-1], [impulses[c] for c in traj.contacts], rtol=1e-13)


@pytest.mark.parametrize("order", ["sorted", "reverse", "random,seed=5"])
@pytest.mark.parametrize("sweeps", [1, 3])
def test_near_list_changes_no_bit(order, sweeps):
    case = crowd(150, 22.0, 3, walls=True)
    runs = [
        nsbench.solve(case, f"pbd[order={order},sweeps={sweeps},reach={reach}]", h=0.02)
        for reach in (0.05, 1.0, 1e9)
    ]
    for r in runs[:-1]:
        assert np.array_equal(r.x, runs[-1].x) and np.array_equal(r.impulse, runs[-1].impulse)
        assert r.contacts == runs[-1].contacts
        assert (
            r.stats["rebuilds"] > 1 and r.stats["contacts_peak"] < runs[-1].stats["contacts_peak"]
        )


@pytest.mark.long
def test_two_thousand_discs_in_a_box_bit_for_bit_with_few_contacts_each():
    for packing, start in ((0.8, "apart"), (0.8, "overlapping")):
        case = box_of_discs(2000, packing, start)
        near, full = (nsbench.solve(case, f"pbd[reach={reach}]", h=0.01) for reach in (0.3, 1e9))
        assert np.array_equal(near.x, full.x) and np.array_equal(near.impulse, full.impulse), start
        assert full.stats["contacts_peak"] > 1_900_000
        pairs = near.stats["contacts_peak"] - 4 * 2000
        assert pairs < (4 if start == "apart" else 12) * 2000, (
            f"{start}: {pairs / 2000:.1f} pairs per disc"
        )


def box_of_discs(n, packing, start):
    """Drift scene: random unit velocities in a box; a jittered lattice, or points thrown at random
    (they overlap)."""
    rng = np.random.default_rng(7)
    size = np.sqrt(n * np.pi / packing)
    if start == "apart":
        side = int(np.ceil(np.sqrt(n * 1.02)))
        cell = (size - 0.001) / side
        lattice = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)[:n]
        x0 = (lattice + 0.5) * cell + rng.uniform(-1, 1, (n, 2)) * (cell / 2 - 1.0)
    else:
        x0 = rng.uniform(1.0, size - 1.0, (n, 2))
    angle = rng.uniform(0, 2 * np.pi, n)
    v = np.stack([np.cos(angle), np.sin(angle)], 1).ravel()
    from scipy.sparse import eye_array, vstack

    eye = eye_array(2 * n)
    walls = Affine(
        vstack([eye, -eye]), np.concatenate([np.full(2 * n, -1.0), np.full(2 * n, size - 1.0)])
    )

    def drift(xp):
        velocity = xp.asarray(v)

        def f(t, x):
            return velocity + 0.0 * x

        return f

    return Case(
        "box",
        Complementarity(drift, (Distance(2.0), walls)),
        x0.ravel(),
        np.linspace(0, 1.0, 6),
        start="keep",
    )


def test_smooth_family_is_projected_on_exactly():
    def inside(xp):
        def g(t, x):
            return xp.stack([1.0 - xp.sqrt(x[0] ** 2 + x[1] ** 2)])

        return g

    def push(xp):
        def f(t, x):
            return xp.array([1.0 - 0.5 * x[1], 0.5 * x[0]])

        return f

    t = np.linspace(0, 2, 11)
    x0 = np.zeros(2)
    smooth = Case("a", Complementarity(push, (Smooth(inside),)), x0, t)
    exact = Case(
        "b",
        Complementarity(push, (Distance(1.0, -1, pairs=[[0, 0]], anchors=[[0.0, 0.0]]),)),
        x0,
        t,
    )
    a, b = (nsbench.solve(c, "pbd", h=0.01) for c in (smooth, exact))
    assert a.stats["loop"] == "host" and b.stats["loop"] == "compiled"
    assert np.abs(a.x - b.x).max() < 1e-12 and np.abs(a.impulse[-1] - b.impulse[-1]).max() < 1e-12


@pytest.mark.long
def test_drift_that_numba_cannot_compile_gives_the_same_bits_in_a_host_loop():
    def odd(xp):
        table = {"rate": -1.0}

        def f(t, x):
            return table["rate"] * x

        return f

    case = crowd(20, 9.0, 2, walls=True)
    slow = case.replace(problem=Complementarity(odd, case.problem.constraints))
    a, b = (nsbench.solve(c, "pbd", h=0.05) for c in (case, slow))
    assert (a.stats["loop"], b.stats["loop"]) == ("compiled", "host")
    assert np.array_equal(a.x, b.x) and np.array_equal(a.impulse, b.impulse)


def test_moving_walls_are_taken_at_the_end_of_the_step():
    def floor(xp):
        def b(t):
            return xp.array([-t])

        return b

    still = np.zeros(1)

    def rest(xp):
        def f(t, x):
            return 0.0 * x

        return f

    case = Case(
        "lift",
        Complementarity(rest, (Affine(np.eye(1), still), Affine(np.eye(1), floor))),
        still,
        np.linspace(0, 1, 11),
    )
    traj = nsbench.solve(case, "pbd", h=0.1)
    assert np.abs(traj.x[:, 0] - case.t).max() < 1e-15
    assert traj.contacts == ((1, 0),) and traj.stats["loop"] == "compiled"
    assert np.abs(traj.impulse[:, 0] - case.t).max() < 1e-14


@pytest.mark.parametrize("name", ["wedge", "rods", "hex"])
def test_violation_after_one_sweep_at_rest_is_the_identity(name):
    """g_k after the sweep = h sum over l processed after k of lambda_l <grad g_k, grad g_l>, to 1
    %."""
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    case = nsbench.get_case(name)
    for h in (1e-3, 1e-4):
        traj = nsbench.solve(case.replace(t=np.append(case.t, case.t[-1] + h)), "pbd", h=h)
        scene = ConstraintSet(case.problem, case.n)
        x = traj.x[-1]
        t = case.t[-1]
        near = scene.near(x, 0.05, t)
        lam = dict(zip(traj.contacts, (traj.impulse[-1] - traj.impulse[-2]) / h, strict=True))
        lam = np.array([lam.get(c, 0.0) for c in near.ids])
        G = scene.dense_gradients(t, x, near)
        predicted = h * np.triu(G @ G.T, 1) @ lam
        measured = scene.gaps(t, x, near)
        assert (lam > 0.0).all()
        worst = int(np.argmin(predicted))
        assert predicted[worst] < 0.0 or name == "wedge"
        assert np.abs(measured - predicted).max() <= 0.01 * np.abs(predicted).max()


@pytest.mark.parametrize(
    "bad", ["pbd[order=sorte]", "pbd[sweeps=0]", "pbd[seed=-1]", "pbd[reach=0]"]
)
def test_bad_options_are_errors_with_the_value(bad):
    with pytest.raises(ValueError, match=bad.split("=")[1][:-1]):
        get(bad)


def test_refuses_with_a_sentence():
    assert "Filippov" in nsbench.solve(nsbench.get_case("sliding"), "pbd").status.why
    assert "none" in nsbench.solve(nsbench.get_case("smooth"), "pbd").status.why


def test_coincident_centres_are_degenerate_and_nan_is_nan():
    case = Case(
        "tie",
        Complementarity(pull, (Distance(2.0),)),
        np.zeros(4),
        np.linspace(0, 1, 3),
        start="keep",
    )
    traj = nsbench.solve(case, "pbd", h=0.1)
    assert traj.status.code == "degenerate" and np.isfinite(traj.x).all()

    def bad(xp):
        def f(t, x):
            return xp.log(0.5 - t) * xp.ones_like(x)

        return f

    case = Case(
        "nan",
        Complementarity(bad, (Affine(np.eye(1), np.zeros(1)),)),
        np.ones(1),
        np.linspace(0, 1, 3),
    )
    traj = nsbench.solve(case, "pbd", h=0.1)
    assert traj.status.code == "nan" and "t = 0.5" in str(traj.status)


def test_infeasible_start_follows_the_policy():
    base = crowd(12, 7.0, 4)
    with pytest.raises(ValueError, match="violates constraint"):
        nsbench.solve(base.replace(start="error"), "pbd", h=0.1)
    traj = nsbench.solve(base.replace(start="project"), "pbd", h=0.1)
    x = traj.x[0].reshape(-1, 2)
    gaps = np.linalg.norm(x[:, None] - x[None], axis=-1)[np.triu_indices(12, 1)] - 2.0
    assert gaps.min() > -1e-11
    assert np.array_equal(nsbench.solve(base, "pbd", h=0.1).x[0], base.x0)


def test_order_of_the_sweep_selects_the_multiplier_and_not_the_reaction():
    """Hexagon: 12 contacts of rank 11. Sorted, reversed: the smallest multiplier; other orders:
    others, for ever."""
    case = nsbench.get_case("hex")
    spacing = np.diff(case.t)[-1]
    found = {}
    for order in ("sorted", "random,seed=2", "random,seed=5"):
        for n in (32, 128):
            traj = nsbench.solve(case, f"pbd[order={order}]", h=spacing / n)
            e = nsbench.errors(case, traj)
            found[order, n] = e["selection"], e["polyhedron"], e["reaction"]
        coarse = found[order, 32]
        fine = found[order, 128]
        assert fine[1] < 0.3 * coarse[1] and fine[2] < 0.3 * coarse[2], (
            "distance to the polyhedron and reaction: O(h)"
        )
    level = [found[order, 128][0] for order in ("sorted", "random,seed=2", "random,seed=5")]
    assert level[0] < 1e-2 and abs(level[1] - 0.577) < 5e-3 and abs(level[2] - 1.155) < 5e-3


def one_step(push, x0, dim, count, reach):
    """State after one step of length 1 of particles with d = 1 by neighbour lists, as the last
    coordinate is none of theirs."""
    families = (Distance(1.0, dim=dim, count=count), Affine(np.eye(len(x0))[-1:], [5.0]))
    drift = lambda xp: lambda t, x: push + 0.0 * x
    case = Case("p", Complementarity(drift, families), x0, np.array([0.0, 1.0]), start="keep")
    return nsbench.solve(case, f"pbd[reach={reach}]", h=1.0)


def test_a_new_list_within_a_sweep_is_not_begun_anew():
    """Parting 0 and 3 puts 0 onto 1 and 2, whose turns with 0 are over in this sweep."""
    x0 = np.array([0.0, 0.0, -0.9, 0.6, -0.9, -0.6, 0.2, 0.0, 0.0])
    traj = one_step(np.zeros(9), x0, 2, 4, 0.1)
    want = x0.copy()
    want[[0, 6]] = -0.4, 0.6
    assert traj.stats["rebuilds"] == 2 and traj.stats["projections"] == 1
    np.testing.assert_allclose(traj.x[-1], want, rtol=0.0, atol=1e-15)


def test_the_second_particle_of_a_pair_is_watched_too():
    """Drift and projection together take 1 beyond half the skin 0.2, and onto 2, not 0."""
    x0 = np.array([0.0, 0.85, 2.055, 0.0])
    traj = one_step(np.array([0.0, 0.09, -0.09, 0.0]), x0, 1, 3, 0.4)
    assert traj.stats["rebuilds"] == 2 and traj.stats["projections"] == 2
    np.testing.assert_allclose(traj.x[-1], [-0.03, 0.9675, 1.9675, 0.0], rtol=0.0, atol=1e-15)
