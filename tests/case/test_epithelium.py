"""The cells feel the forces of their stated energies, start feasible, and compute the same in
numpy, numba and JAX."""

import numpy as np
import pytest

import nsbench
from nsbench.case import case_module
from nsbench.compilation import factories
from nsbench.dynamics.contacts.constraint_set import ConstraintSet

KINDS = (
    {},
    {"r_hard": 0.7},
    {"n": 3},
    {"n": 5, "free_basal": True},
    {"n": 5, "curvature": 0.1},
    {"n": 2, "mu": 0.02},
)
K = 2.0
K_S = 15.0
R_S = 1.0
ETA_RATE = 5.0


@pytest.fixture(params=KINDS, ids=str)
def case(request):
    return nsbench.get_case("epithelium", **request.param)


def full(case):
    return {"mu": 0.2, "curvature": 0.0, "r_hard": 0.3, **case.params}


def generic(case):
    """A state with distances on both sides of every kink and points off the symmetric start."""
    rng = np.random.default_rng(3)
    return case.x0 + rng.uniform(-0.15, 0.15, case.n)


def split(case, x):
    """A, X, B (n, 2), the rest lengths (2n + 1,) and where they start, written out a second
    time."""
    free = full(case).get("free_basal", False)
    n = (case.n - 1) // (8 if free else 7)
    A = x[: 2 * n].reshape(n, 2)
    X = x[2 * n : 4 * n].reshape(n, 2)
    s = x[4 * n : case.n - 2 * n - 1]
    k = full(case)["curvature"]
    if free:
        B = s.reshape(n, 2)
    elif k:
        B = np.array([[np.sin(k * v) / k, np.cos(k * v) / k - 1 / k] for v in s])
    else:
        B = np.array([[v, 0.0] for v in s])
    return A, X, B, x[-2 * n - 1 :], case.n - 2 * n - 1


def energy(case, x, rest):
    """The sum of the four energies with the rest lengths frozen; loops and angles instead of slices
    and products."""
    A, X, B, _, _ = split(case, x)
    n = len(A)
    e = 0.0
    for i in range(n):
        for end, eta in ((A[i], rest[i]), (B[i], rest[n + i])):
            e += K * (np.linalg.norm(X[i] - end) / (eta + R_S) - 1) ** 2
        a = X[i] - A[i]
        b = X[i] - B[i]
        e += K_S * np.cos(np.arctan2(a[1], a[0]) - np.arctan2(b[1], b[0]))
        for j in range(i):
            e += 1.0 * (min(np.linalg.norm(X[i] - X[j]) / (2 * R_S), 1) - 1) ** 2
    for i in range(n - 1):
        e += 0.5 * 0.25 * 0.5 * (5 + 5) * (np.linalg.norm(A[i + 1] - A[i]) - rest[-1]) ** 2
    return e


def test_forces_are_minus_the_gradient_of_the_energy(case):
    x = generic(case)
    f = case.problem.drift(np)(0.0, x)
    *_, rest, end = split(case, x)
    for i in range(end):
        up = x.copy()
        down = x.copy()
        up[i] = x[i] + 1e-6
        down[i] = x[i] - 1e-6
        force = -(energy(case, up, rest) - energy(case, down, rest)) / (up[i] - down[i])
        assert f[i] * full(case)["mu"] == pytest.approx(force, abs=3e-7)


def test_straight_cells_have_the_lowest_energy():
    case = nsbench.get_case("epithelium", n=2)
    straight = np.array(
        [0, 8, 9, 8, 0, 4, 9, 4, 0, 9, 1.5, 1.5, 1.5, 1.5, 9.0]
    )  # two cells that do not meet
    bent = straight.copy()
    bent[4] += 0.5
    rest = straight[-5:]
    assert energy(case, straight, rest) < energy(case, bent, rest)
    assert case.problem.drift(np)(0.0, bent)[4] < 0.0


def test_rest_lengths_follow_their_equations_without_friction(case):
    x = generic(case)
    A, X, B, rest, end = split(case, x)
    want = [
        -ETA_RATE * (eta - max(0.0, np.linalg.norm(q - p) - R_S))
        for eta, q, p in zip(rest, [*X, *X], [*A, *B], strict=False)
    ] + [-rest[-1]]
    assert case.problem.drift(np)(0.0, x)[end:] == pytest.approx(want, abs=1e-13)


def test_the_rest_length_stops_at_zero():
    case = nsbench.get_case("epithelium", n=2)
    x = case.x0.copy()
    x[4:6] = x[0:2] - [0.0, 0.5]  # a nucleus nearer to its apical point than R_s
    assert case.problem.drift(np)(0.0, x)[10] == -ETA_RATE * 1.5


@pytest.mark.parametrize("kind", [{}, {"r_hard": 0.7}, {"n": 5, "free_basal": True}], ids=str)
def test_internal_forces_sum_to_zero(kind):
    case = nsbench.get_case("epithelium", **{**kind, "free_basal": True})
    *_, end = split(case, case.x0)
    f = case.problem.drift(np)(0.0, generic(case))[:end].reshape(-1, 2)
    assert f.sum(0) == pytest.approx([0, 0], abs=1e-11)
    assert np.abs(f).max() > 1.0


@pytest.mark.parametrize(
    "kind", [{"n": 5, "free_basal": True}, {"n": 5, "curvature": 0.1}], ids=str
)
def test_jax_computes_and_differentiates_the_same(kind):
    import jax

    case = nsbench.get_case("epithelium", **kind)
    x = generic(case)
    v = np.random.default_rng(0).standard_normal(case.n)
    f = case.problem.drift(np)
    g = factories.as_jax(case.problem.drift)
    value, slope = jax.jit(lambda x: jax.jvp(lambda y: g(0.0, y), (x,), (v,)))(x)
    assert np.asarray(value) == pytest.approx(f(0.0, x), abs=1e-12)
    assert np.asarray(slope) == pytest.approx(
        (f(0.0, x + 1e-6 * v) - f(0.0, x - 1e-6 * v)) / 2e-6, abs=1e-5
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", [*KINDS, {"n": 100, "r_hard": 0.7}], ids=str)
def test_starts_feasible(kind, seed):
    case = nsbench.get_case("epithelium", seed=seed, **kind)
    scene = ConstraintSet(case.problem, case.n)
    near = scene.near(case.x0, 0.5)
    gaps = scene.gaps(0.0, case.x0, near)
    assert gaps.min() >= -1e-12
    _, X, _, _, _ = split(case, case.x0)
    apart = min(np.linalg.norm(X[i] - X[j]) for i in range(len(X)) for j in range(i))
    assert apart - 2 * full(case)["r_hard"] >= -1e-12
    assert np.array_equal(case.x0, nsbench.get_case("epithelium", seed=seed, **kind).x0)


def test_links_mean_the_same_distance_on_a_line_a_circle_and_in_the_plane():
    for kind in ({}, {"curvature": 0.3}, {"free_basal": True}):
        case = nsbench.get_case("epithelium", n=4, **kind)
        scene = ConstraintSet(case.problem, case.n)
        x = case.x0.copy()
        for by, sign in ((0.01, 1), (-0.01, -1)):  # squeeze, then stretch the basal line
            y = x.copy()
            *_, end = split(case, y)
            y[16:end] *= 1 - by
            static = scene.all_static()
            links = np.array([f for f, *_ in static.ids]) == 2
            B = split(case, y)[2]
            length = np.linalg.norm(np.diff(B, axis=0), axis=1)
            gaps = scene.gaps(0.0, y, static)[links]
            assert np.all(np.sign(gaps) == sign) and np.all(np.sign(1 / 3 - length) == sign)
            if not kind.get("curvature"):
                assert gaps == pytest.approx(1 / 3 - length, abs=1e-14)


def fastest(case, x):
    """The largest decay rate of the drift at x, from differences."""
    f = case.problem.drift(np)
    J = np.empty((case.n, case.n))
    for i, e in enumerate(1e-6 * np.eye(case.n)):
        J[:, i] = (f(0.0, x + e) - f(0.0, x - e)) / 2e-6
    return -np.linalg.eigvals(J).real.min()


@pytest.mark.parametrize(
    "kind", [{}, {"r_hard": 0.7}, {"n": 60, "r_hard": 0.7, "mu": 0.02}, {"n": 3}], ids=str
)
def test_the_coarsest_step_resolves_the_stiffest_force(kind):
    case = nsbench.get_case("epithelium", **kind)
    assert 1.0 < fastest(case, case.x0) * (case.t[1] - case.t[0]) < case.substeps


def test_the_coarsest_step_resolves_a_nucleus_that_came_near_its_apical_point():
    case = nsbench.get_case("epithelium", n=2, mu=0.02)
    x = np.array([0, 8, 9, 8, 0, 8 - 0.86, 9, 4, 0, 9, 1.5, 5.5, 1.5, 1.5, 9.0])
    assert fastest(case, case.x0) < 0.5 * fastest(case, x)
    assert fastest(case, x) * (case.t[1] - case.t[0]) < case.substeps


def test_observables_of_a_scene_drawn_by_hand():
    observe = case_module("epithelium").observables
    case = nsbench.get_case("epithelium", n=3)
    x = np.array([0, 8, 1, 8, 1, 9, 0, 8.5, 1, 9, 1, -1, 0, 0.5, 1, *[1.5] * 6, 1 / 3], dtype=float)
    seen = {k: v.tolist() for k, v in observe(case, np.stack((x, x))).items()}
    want = {
        "apical_height": 25 / 3,
        "nuclear_height": 5.5,
        "basal_height": 0.0,
        "apical_width": 1.0,
        "nuclear_width": 1.0,
        "basal_width": 1.0,
        "straightness": np.sqrt(2) / 2,
        "apical_extrusions": 2,
        "basal_extrusions": 1,
        "nuclear_gap": np.sqrt(1.25) - 0.6,
    }
    assert set(seen) == set(want)
    for name, value in want.items():
        assert seen[name] == pytest.approx([value, value]), name


def test_bad_parameters_are_refused_at_the_border():
    for bad in (
        {"n": 1},
        {"T": 0.0},
        {"mu": -1.0},
        {"curvature": 0.1, "free_basal": True},
        {"curvature": 2.0},
    ):
        with pytest.raises(ValueError, match=r"n = |curvature"):
            nsbench.get_case("epithelium", **bad)
