"""Neighbour lists of catching-up: no pair that a certified list leaves out can matter to a step."""

import numpy as np
import pytest

import nsbench
from nsbench import get_case
from nsbench.compilation.decorators import python_entry
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ListedContacts
from nsbench.solvers.catching_up.kernels import candidates, list_certificate
from nsbench.solvers.catching_up.kernels.list_certificate import next_skin

gather = python_entry(candidates.gather)
needed_skins = python_entry(list_certificate.needed_skins)


def moved(rng, x, strain, turn, noise):
    """Particles (n, dim) moved by a similarity, a rotation and at random."""
    centre = rng.normal(size=x.shape[1])
    away = x - centre
    rotated = away[:, ::-1] * np.where(np.arange(x.shape[1]) % 2, 1.0, -1.0)
    return x + strain * away + turn * rotated + noise * rng.normal(size=x.shape) + centre


def linearised_gaps(base, x, y, D):
    """By pair the distance at base, and the gap of the step x -> y linearised at x."""
    i, j = np.triu_indices(len(x), 1)
    apart = x[i] - x[j]
    distance = np.linalg.norm(apart, axis=1)
    normal = apart / distance[:, None]
    gap = distance - D + np.einsum("kc,kc->k", normal, (y - x)[i] - (y - x)[j])
    return np.linalg.norm(base[i] - base[j], axis=1), gap


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("strain", [-0.3, -0.05, 0.0, 0.2])
def test_no_pair_beyond_the_needed_skin_is_violated(dim, strain):
    rng = np.random.default_rng(int(1000 * (strain + 1.0)) + dim)
    for _ in range(20):
        n = 60
        base = rng.uniform(-20.0, 20.0, size=(n, dim))
        x = moved(rng, base, strain, 0.05 * (dim == 2), 0.05)
        y = moved(rng, x, 0.7 * strain, 0.03 * (dim == 2), 0.02)
        hard = np.array([[0, 0, n, dim]])
        flat = [a.ravel().copy() for a in (base, x, y)]
        since, alone = needed_skins(*flat, hard, np.full(n, 0.5), 0.0)
        for skin, at in ((since, base), (alone, x)):
            distance, gap = linearised_gaps(at, x, y, 1.0)
            assert np.all(gap[distance > 1.0 + skin] >= -1e-12)
        far = np.linalg.norm(x - base, axis=1).max() + np.linalg.norm(y - x, axis=1).max()
        assert since <= 2.0 * far * (1.0 + 1e-12)


def test_particles_that_are_drawn_together_need_little_skin():
    """They move by ten of their sizes, neighbours by a twentieth of their distance."""
    rng = np.random.default_rng(1)
    base = rng.uniform(-200.0, 200.0, size=(500, 2))
    y = 0.95 * base
    hard = np.array([[0, 0, 500, 2]])
    flat = base.ravel().copy()
    since, alone = needed_skins(flat, flat, y.ravel().copy(), hard, np.full(500, 0.5), 0.0)
    assert since == alone == pytest.approx(0.05 / 0.95, rel=1e-6)
    # where a list with the skin that it has suffices, nothing is fitted
    plain, _ = needed_skins(flat, flat, y.ravel().copy(), hard, np.full(500, 0.5), 1e3)
    assert plain == pytest.approx(2.0 * np.linalg.norm(base - y, axis=1).max())


@pytest.mark.parametrize("widest", [0, 1, 2])
def test_the_widest_particle_of_any_family_counts(widest):
    """Drawn together by s, a pair at contact needs the skin 2 r s / (1 - s), r the largest."""
    rng = np.random.default_rng(2)
    base = rng.uniform(-200.0, 200.0, size=(6, 2)).ravel()
    y = base.copy()
    y[6:] = 0.95 * base[6:]
    radii = np.full(6, 0.1)
    radii[3 + widest] = 0.5
    hard = np.array([[0, 0, 3, 2], [1, 6, 3, 2]])
    since, alone = needed_skins(base, base, y, hard, radii, 0.0)
    assert since == alone == pytest.approx(2.0 * 0.5 * 0.05 / 0.95, rel=1e-6)


def test_lists_outlive_their_step_until_they_are_long():
    assert next_skin.py_func(0.3, 0.01) == 0.3
    assert next_skin.py_func(0.3, 0.2) == pytest.approx(0.8)
    assert next_skin.py_func(0.3, 1.0) == pytest.approx(2.4)
    assert next_skin.py_func(0.3, 10.0) == pytest.approx(12.5)


@pytest.mark.parametrize("h", [0.3, 0.05])
def test_steps_over_lists_are_those_over_all_pairs(h):
    """A reach beyond the whole scene lists every pair."""
    case = get_case("discs", n=30, seed=2)
    few = nsbench.solve(case, "catching_up", h=h)
    every = nsbench.solve(case, "catching_up[reach=1e3]", h=h)
    assert every.stats["contacts_peak"] == 435 > few.stats["contacts_peak"]
    assert np.abs(few.x - every.x).max() < 1e-11


def test_near_pairs_of_two_families_are_listed_as_they_are():
    """On a line of 4 particles in space and a plane of 100: more pairs than a list has at first."""
    n = (4, 100)
    dim = (3, 2)
    rows = np.stack(np.divmod(np.arange(100), 10), 1)
    x = np.concatenate((np.outer(np.arange(4.0), [1.0, 0.0, 0.0]).ravel(), rows.ravel()))
    hard = np.array([[0, 0, 4, 3], [1, 12, 100, 2]])
    radii = np.concatenate((np.full(4, 0.45), np.full(100, 0.4)))
    none = ListedContacts(*(np.empty(0, np.int64),) * 6, *(np.empty(0),) * 2, np.empty(0, np.int64))
    out, keys = gather(x, 0.25, none, hard, radii)
    want = []
    for f in range(2):
        points = x[hard[f, 1] :][: n[f] * dim[f]].reshape(n[f], dim[f])
        for i, j in zip(*np.triu_indices(n[f], 1), strict=True):
            if np.linalg.norm(points[i] - points[j]) < 1.2:
                at = hard[f, 1] + dim[f] * np.array([i, j])
                want.append((PAIR, f, i, j, *at, 0.9 - 0.1 * f, 1.0, dim[f]))
    assert len(want) == 3 + 180 == len(keys) and np.all(np.diff(keys) > 0)
    np.testing.assert_allclose(np.transpose(out), want, rtol=1e-15)
