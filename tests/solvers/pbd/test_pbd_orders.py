"""The orders of PBD by cells and by colours are what they say, and whatever may run at once gives
the same bits."""

import itertools

import numpy as np
import pytest
from test_pbd import box_of_discs, crowd, plain

import nsbench
from nsbench.compilation.decorators import python_entry
from nsbench.dynamics.contacts.kernels import constraint_order
from nsbench.dynamics.contacts.kernels.constraint_order import cell_ranks

colour_levels = python_entry(constraint_order.colour_levels)

WORD = 2**64 - 1


def mix(z):
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & WORD
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & WORD
    return z ^ (z >> 31)


def colour(i, j, seed):
    """One of 16, from the labels alone, in plain integers."""
    shift = (seed + 1) * 0x9E3779B97F4A7C15
    return (mix(i + shift & WORD) + mix(j + shift & WORD) & WORD) >> 60


def by_colour(seed):
    return lambda c: (0, colour(*c[1:], seed), *c[1:]) if c[0] == 0 else c


def by_cell(case):
    """Discs numbered by rows of cells of side 2, the lowest row first."""
    x = case.x0.reshape(-1, 2)
    lo = x.min(axis=0)
    order = sorted(
        range(len(x)),
        key=lambda i: (int((x[i, 1] - lo[1]) // 2.0), int((x[i, 0] - lo[0]) // 2.0), i),
    )
    rank = {i: k for k, i in enumerate(order)}
    return lambda c: (0, *sorted((rank[c[1]], rank[c[2]]))) if c[0] == 0 else c


@pytest.mark.parametrize("walls", [False, True])
@pytest.mark.parametrize("order", ["cell", "coloured", "coloured,seed=3"])
def test_is_the_sweep_over_all_pairs_in_the_stated_order(order, walls):
    case = crowd(30, 12.0, 1, walls)
    keys = by_cell(case) if order == "cell" else by_colour(3 if "seed" in order else 0)
    X, impulses = plain(case, 0.05, 1, keys)
    traj = nsbench.solve(case, f"pbd[order={order},reach=0.1]", h=0.05)
    assert np.array_equal(traj.x, X)
    assert set(traj.contacts) == set(impulses)
    assert np.allclose(traj.impulse[-1], [impulses[c] for c in traj.contacts], rtol=1e-13)


@pytest.mark.parametrize("order", ["cell", "coloured"])
@pytest.mark.parametrize("sweeps", [1, 3])
def test_near_list_changes_no_bit(order, sweeps):
    case = crowd(150, 22.0, 3, walls=True)
    near, full = (
        nsbench.solve(case, f"pbd[order={order},sweeps={sweeps},reach={reach}]", h=0.02)
        for reach in (0.05, 1e9)
    )
    assert (
        np.array_equal(near.x, full.x)
        and np.array_equal(near.impulse, full.impulse)
        and near.contacts == full.contacts
    )
    assert near.stats["rebuilds"] > 1


def test_levels_share_no_particle_and_any_order_within_them_gives_the_bits_of_the_sweep():
    n = 300
    case = box_of_discs(n, 0.8, "overlapping")
    i, j = np.triu_indices(n, 1)
    key = np.array([(colour(a, b, 0), a, b) for a, b in zip(i.tolist(), j.tolist(), strict=True)])
    o = np.lexsort(key.T[::-1])
    i = i[o]
    j = j[o]
    near = np.hypot(*(case.x0.reshape(-1, 2)[i] - case.x0.reshape(-1, 2)[j]).T) < 4.0
    i = i[near]
    j = j[near]
    level = colour_levels(i, j, n)

    def sweep(order):
        x = case.x0.reshape(-1, 2).copy()
        for c in order:
            u = x[i[c]] - x[j[c]]
            s = u[0] * u[0] + u[1] * u[1]
            if s < 4.0:
                w = -0.5 * (np.sqrt(s) - 2.0) / np.sqrt(s)
                x[i[c]] += w * u
                x[j[c]] -= w * u
        return x

    once = sweep(range(len(i)))
    for seed in range(3):  # any partition among threads is one of these
        shuffled = np.random.default_rng(seed).permutation(len(i))
        assert np.array_equal(sweep(shuffled[np.argsort(level[shuffled], kind="stable")]), once)
    for k in range(level.max() + 1):
        both = np.concatenate((i[level == k], j[level == k]))
        assert len(both) == len(set(both.tolist())), "no particle twice in a level"


def test_ranks_number_every_particle_once_row_by_row():
    x = np.array([[5.0, 0.1], [0.0, 0.0], [0.5, 2.5], [1.5, 0.3], [4.9, 2.1]])
    assert cell_ranks(x.ravel(), 2, 2.0).tolist() == [2, 0, 3, 1, 4]


@pytest.mark.parametrize("order", ["reverse", "random", "cell", "coloured"])
def test_smooth_scenes_in_the_host_loop_keep_the_order(order):
    def never(xp):
        def g(t, x):
            return xp.stack([x[0] * 0.0 + 1.0])

        return g

    case = crowd(12, 7.0, 4)
    slow = case.replace(
        problem=nsbench.Complementarity(
            case.problem.drift, (*case.problem.constraints, nsbench.Smooth(never))
        )
    )
    a, b = (nsbench.solve(c, f"pbd[order={order}]", h=0.05) for c in (case, slow))
    assert (a.stats["loop"], b.stats["loop"]) == ("compiled", "host")
    assert np.array_equal(a.x, b.x)


@pytest.mark.long
@pytest.mark.parametrize("order", ["cell", "coloured"])
@pytest.mark.parametrize("name", ["tide", "discs[n=3]", "hex"])
def test_the_claimed_order_is_reached(order, name):
    case = nsbench.get_case(name)
    spacing = float(np.diff(case.t).max())
    h = []
    state = []
    for n in (8, 13, 21, 34, 55, 89):
        traj = nsbench.solve(case, f"pbd[order={order}]", h=spacing / n)
        assert traj.status.ok
        h.append(traj.stats["h"])
        state.append(nsbench.errors(case, traj)["state_sup"])
    slope = np.polyfit(np.log(h), np.log(state), 1)[0]
    assert abs(slope - 1.0) < 0.1, f"{slope:.3f}"


def test_pairs_of_orders_differ():
    case = crowd(30, 12.0, 1, True)
    X = [
        nsbench.solve(case, f"pbd[order={o}]", h=0.05).x
        for o in ("sorted", "reverse", "random", "cell", "coloured")
    ]
    assert not any(np.array_equal(a, b) for a, b in itertools.combinations(X, 2))
