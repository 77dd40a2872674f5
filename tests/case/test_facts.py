"""What the cases say of themselves is so: their constants, orders and degeneracies, measured with
the methods."""

from itertools import combinations

import numpy as np
import pytest

import nsbench
from nsbench.dynamics.contacts.constraint_set import ConstraintSet


def stepwise(case, spec, n):
    """A run of n equal steps, all of them recorded: the trajectory and the multipliers of each
    step, (n, m)."""
    t = np.linspace(case.t[0], case.t[-1], n + 1)
    traj = nsbench.solve(case.replace(t=t), spec, h=t[1] - t[0])
    assert traj.status.ok, str(traj.status)
    return traj, np.diff(traj.impulse, axis=0) / np.diff(t)[:, None]


def slope(h, e):
    return np.polyfit(np.log(h), np.log(e), 1)[0]


def gaps(case, t, x, reach=0.5):
    scene = ConstraintSet(case.problem, case.n)
    near = scene.near(x, reach, t)
    return dict(zip(near.ids, scene.gaps(t, x, near), strict=True))


@pytest.mark.long
@pytest.mark.parametrize("psi", [10, 30, 60, 80, 100, 120, 150, 170])
def test_a_wedge_is_left_violated_by_the_last_load_times_the_cosine_and_beyond_90_degrees_by_nothing(
    psi,
):
    case = nsbench.get_case("wedge", psi=float(psi))
    traj, lam = stepwise(case, "pbd", 2000)
    g = gaps(case, case.t[-1], traj.x[-1])
    h = 1e-3
    cos = np.cos(np.radians(psi))
    if psi < 90:
        assert g[0, 0] == pytest.approx(-h * lam[-1, 1] * cos, rel=1e-6)
        assert abs(g[0, 1]) < 1e-14
    else:
        assert min(g.values()) > -1e-14


def test_a_row_of_rods_is_violated_by_h_n_squared_over_eight():
    for n in (6, 10):
        case = nsbench.get_case("rods", n=n)
        h = 1e-4
        traj = nsbench.solve(case, "pbd", h=h)
        assert min(gaps(case, 2.0, traj.x[-1]).values()) == pytest.approx(-h * n * n / 8, rel=0.01)


@pytest.mark.parametrize("spec, before", [("pbd", False), ("pbd[order=reverse]", True)])
def test_rods_at_a_wall_bear_n_minus_i_plus_1_and_each_sweep_leaves_its_own_violation(spec, before):
    n = 6
    case = nsbench.get_case("rods_wall", n=n)
    traj, lam = stepwise(case, spec, 4000)
    order = np.argsort([c[1] for c in traj.contacts])
    want = np.arange(n, 0, -1.0)
    assert lam[-1, order] == pytest.approx(want, rel=1e-9)
    g = gaps(case, case.t[-1], traj.x[-1])
    left = np.append(0.0, want[:-1]) if before else np.append(want[1:], 0.0)
    assert [g[0, i] for i in range(n)] == pytest.approx(-5e-4 * left, abs=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    "spec", ["pbd", "pbd[order=reverse]", "catching_up", "penalty", "event_driven"]
)
@pytest.mark.parametrize("psi", [90.0, 120.0])
def test_a_closed_wall_that_bears_nothing_is_no_failure(spec, psi):
    case = nsbench.get_case("corner_degenerate", psi=psi)
    traj = nsbench.solve(case, spec)
    assert traj.status.ok, str(traj.status)
    late = (case.t > 1.5).nonzero()[0]
    acts = dict(
        zip(
            (c[1] for c in traj.contacts),
            (traj.impulse[late[-1]] - traj.impulse[late[0]]),
            strict=True,
        )
    )
    assert acts[0] == pytest.approx(
        np.diff(case.exact_impulse(case.t[late[[0, -1]]])[:, 0])[0], abs=1e-3
    )
    assert abs(acts.get(1, 0.0)) < 2e-2  # the penalty at its default still creeps along


@pytest.mark.long
@pytest.mark.parametrize("spec", ["pbd", "catching_up"])
def test_a_graze_has_order_one_half_in_the_supremum_and_one_in_the_mean(spec):
    case = nsbench.get_case("graze")
    steps = np.array([97, 151, 233, 367, 571, 887, 1381, 2153, 3343, 5197])
    sup = []
    total = []
    for n in steps:
        lam = stepwise(case, spec, n)[1]
        sup.append(lam.max())
        total.append(lam.sum() * 2.0 / n)
    assert slope(1 / steps, sup) == pytest.approx(0.5, abs=0.05)
    assert slope(1 / steps, total) == pytest.approx(1.0, abs=0.05)


def test_steps_longer_than_a_near_miss_find_a_contact_that_is_none():
    case = nsbench.get_case("graze", delta=0.02)
    for n, touches in ((50, True), (90, True), (110, False), (1000, False)):
        assert (len(stepwise(case, "pbd", n)[0].contacts) > 0) == touches


@pytest.mark.parametrize("spec", ["pbd", "catching_up"])
def test_a_stiff_contact_needs_steps_below_two_over_its_stiffness(spec):
    case = nsbench.get_case("stiff_contact")
    errors = {
        f: np.abs(
            nsbench.solve(case.replace(t=np.linspace(0, 6, 5)), spec, h=f / 100.0).x[:, 0]
            - case.exact(np.linspace(0, 6, 5))[:, 0]
        ).max()
        for f in (0.5, 1.8, 2.2)
    }
    assert errors[0.5] < 1e-3 and errors[1.8] < 0.1 and errors[2.2] > 0.5
    lam = np.diff(case.exact_impulse(np.linspace(0, 6, 601))[:, 0]) / 0.01
    assert 99.0 < lam.max() < 101.0


def test_a_buckling_row_looks_like_a_plateau_before_it_converges():
    case = nsbench.get_case("buckling_row")
    exact = nsbench.solve(case, "event_driven", tol=1e-10).x
    off = {
        n: np.abs(nsbench.solve(case, "pbd", h=2.0 / n).x - exact).max()
        for n in (400, 800, 1600, 102400)
    }
    assert all(off[n] > 2.0 for n in (400, 800, 1600)) and off[400] < 2 * off[1600]
    assert off[102400] < 0.1


def test_the_later_a_central_impact_is_left_the_more_its_height_matters():
    for b in (0.2, 0.02):
        ends = [nsbench.get_case("obstacle", b=b * (1 + s)).exact_events[1] for s in (1e-6, -1e-6)]
        assert (ends[0] - ends[1]) / (2e-6 * b) == pytest.approx(
            -1 / b, rel=0.05 if b > 0.1 else 1e-3
        )


def test_in_the_unit_box_each_wall_is_reached_as_the_last_one_is_left():
    case = nsbench.get_case("box_turning")
    traj = nsbench.solve(case, "event_driven")
    for k in (2, 3, 4):
        at = [e.kind for e in traj.events if abs(e.t - k * np.pi / 2) < 1e-9]
        assert {"contact", "release"} <= set(at)


def test_pulled_beads_stop_in_arithmetic_progression():
    stops = np.array(nsbench.get_case("chain", links=8).exact_events)
    assert np.ptp(np.diff(stops)) < 1e-14
    found = [e.t for e in nsbench.solve(nsbench.get_case("chain", links=8), "event_driven").events]
    assert np.abs(np.unique(np.round(found, 12)) - stops).max() < 1e-11


def angles(case):
    """Normalised products of the gradients of contacts that share a disc."""
    scene = ConstraintSet(case.problem, case.n)
    near = scene.near(case.x0, 1e-9, 0.0)
    G = scene.dense_gradients(0.0, case.x0, near)
    unit = G / np.linalg.norm(G, axis=1)[:, None]
    return [
        unit[a] @ unit[b]
        for a, b in combinations(range(len(G)), 2)
        if set(near.ids[a][1:]) & set(near.ids[b][1:])
    ], G


@pytest.mark.parametrize("loops", [0.0, 0.5, 0.9])
def test_kissing_discs_meet_at_products_between_minus_a_half_and_a_quarter(loops):
    for seed in range(10):
        case = nsbench.get_case("kissing", n=30, seed=seed, loops=loops)
        products, G = angles(case)
        assert -0.5 - 1e-12 <= min(products) and max(products) <= 0.25 + 1e-12
        assert len(G) == len(case.contacts) and np.linalg.matrix_rank(G, rtol=1e-10) == len(G)


def still(xp):
    def f(t, x):
        return 0.0 * x

    return f


def sweep(x, order="sorted"):
    """One sweep of exact projections of unit discs, alone: the point, and the contacts that
    acted."""
    problem = nsbench.Complementarity(still, (nsbench.Distance(d=2.0),))
    case = nsbench.Case("sweep", problem, x, np.array([0.0, 1.0]), start="keep")
    traj = nsbench.solve(case, f"pbd[order={order}]", h=1.0)
    return traj.x[-1], [c for c, i in zip(traj.contacts, traj.impulse[-1], strict=True) if i > 0.0]


def test_a_chain_reaction_goes_as_far_as_the_order_of_the_sweep_follows_it():
    n = 12
    x = np.zeros(2 * n)
    x[::2] = 2.0 * np.arange(n)
    x[0] += 0.01  # the first disc of a kissing row overlaps the second
    forth = sweep(x)[1]
    back = sweep(x, "reverse")[1]
    assert len(forth) == n - 1 and back == [(0, 0, 1)]
    pushed = 0  # in a graph: contacts that were open before the sweep
    for seed in range(5):
        case = nsbench.get_case("kissing", seed=seed)
        y = case.x0 + 1e-3 * np.random.default_rng(seed).standard_normal(case.n)
        open_before = {c for c, g in gaps(case, 0.0, y).items() if g > 0.0}
        pushed += len(open_before & set(sweep(y)[1]))
    assert pushed > 0


@pytest.mark.long
def test_one_sweep_moves_and_leaves_no_more_than_a_constant_times_the_violation():
    """The two lemmas on P: |P y - y| <= C1 max violation, and what is left is at most C2 times it,
    whatever its size."""
    for seed in range(3):
        case = nsbench.get_case("kissing", seed=seed)
        constants = {}
        for size in (1e-2, 1e-3, 1e-4):
            moved = []
            left = []
            for k in range(10):
                y = case.x0 + size * np.random.default_rng(k).standard_normal(case.n)
                violation = -min(gaps(case, 0.0, y).values())
                z = sweep(y)[0]
                moved.append(np.linalg.norm(z - y) / violation)
                left.append(max(0.0, -min(gaps(case, 0.0, z).values())) / violation)
            constants[size] = max(moved), max(left)
        assert constants[1e-3] == pytest.approx(constants[1e-4], rel=0.05), (
            "the constants do not depend on the size"
        )
        assert constants[1e-2] == pytest.approx(constants[1e-4], rel=0.5)
        assert (
            constants[1e-4][0] < 2.0 and constants[1e-4][1] < 1.5
        )  # of many more points: 1.6 and 1.1


@pytest.mark.long
def test_an_overlapping_start_means_what_the_case_says():
    spec = {
        "pbd": {"h": 1e-2},
        "catching_up": {"h": 1e-2},
        "penalty": {"k": 1e3},
        "event_driven": {},
    }
    for name, accuracy in spec.items():
        kept = nsbench.solve(nsbench.get_case("overlap_start"), name, **accuracy)
        if name == "event_driven":
            assert kept.status.code == "refused" and "keep" in kept.status.why
        else:
            assert kept.status.ok and np.array_equal(
                kept.x[0], nsbench.get_case("overlap_start").x0
            )
            end = gaps(nsbench.get_case("overlap_start"), 1.0, kept.x[-1])
            assert min(end.values()) > -0.05, "the overlaps of 1.2 were not worked off"
        projected = nsbench.get_case("overlap_start", meaning="project")
        traj = nsbench.solve(projected, name, **accuracy)
        assert traj.status.ok and abs(min(gaps(projected, 0.0, traj.x[0]).values())) < 1e-9
        with pytest.raises(ValueError, match=r"violates constraint \(0, 3, 4\)"):
            nsbench.solve(nsbench.get_case("overlap_start", meaning="error"), name, **accuracy)
    with pytest.raises(ValueError, match="coincident centres"):
        nsbench.solve(
            nsbench.get_case("overlap_start", meaning="project", spread=0.0), "pbd", h=0.1
        )


def test_the_projected_start_is_the_nearest_feasible_point():
    """Against a general optimiser from the same place; linearised once, discs end up too far
    apart."""
    from scipy.optimize import minimize

    from nsbench.solvers.common.initial_state import initial_state

    for seed in range(4):
        case = nsbench.get_case("overlap_start", meaning="project", seed=seed)
        y = initial_state(case, ConstraintSet(case.problem, case.n))
        i, j = np.triu_indices(case.n // 2, 1)

        def apart(x, i=i, j=j):
            p = x.reshape(-1, 2)
            return np.hypot(*(p[i] - p[j]).T) - 2.0

        assert abs(apart(y).min()) < 1e-12
        best = minimize(
            lambda x, x0=case.x0: np.sum((x - x0) ** 2),
            y + 1e-3,
            method="SLSQP",
            constraints={"type": "ineq", "fun": apart},
            options={"ftol": 1e-15, "maxiter": 1000},
        )
        assert np.sum((y - case.x0) ** 2) <= best.fun + 1e-9
