"""Multiplier errors: contacts matched by id, redundant ones measured from the set of solutions,
ranks and candidates as by dense algebra."""

import dataclasses
import itertools

import numpy as np
import pytest
from exact_runs import exact_run
from scipy.optimize import linprog

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Hybrid, Transition, get_case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.measure.context import context_of, full_rank, near_of, pattern
from nsbench.measure.errors import below_reference
from nsbench.measure.multiplier_sets import _resting, polyhedron
from nsbench.measure.residuals import interval_residuals
from nsbench.trajectory import Event

TIDE = get_case("tide")
FLOORS = ("state", "impulse", "reaction", "event")


def test_contacts_are_matched_by_id_whichever_way_round_and_an_absent_one_is_zero():
    case = get_case("two_discs")
    run = exact_run(case)
    ((i, a, b),) = run.contacts
    assert nsbench.errors(case, exact_run(case, contacts=((i, b, a),)))["impulse"] == 0.0
    none = exact_run(case, contacts=(), impulse=np.empty((len(case.t), 0)))
    assert nsbench.errors(case, none)["impulse"] == run.impulse.max()
    both = np.hstack([run.impulse, 0.25 * case.t[:, None]])
    wide = TIDE.replace(
        problem=Complementarity(
            TIDE.problem.drift, (Affine(np.eye(1), np.zeros(1)), Affine(np.eye(1), np.ones(1)))
        ),
        contacts=((0, 0),),
    )
    e = nsbench.errors(
        wide,
        exact_run(
            wide,
            contacts=((0, 0), (1, 0)),
            impulse=np.hstack([TIDE.exact_impulse(TIDE.t), 0.25 * TIDE.t[:, None]]),
        ),
    )
    assert (
        e["impulse"] == pytest.approx(0.75)
        and e["l1"] == pytest.approx(0.75)
        and both.shape[1] == 2
    )


def test_redundant_multipliers_have_a_selection_and_no_error():
    case = get_case("duplicate")
    push = TIDE.exact_impulse(case.t)
    rest = (case.t[:-1] > np.pi / 6) & (case.t[1:] < np.pi / 2)
    load = (np.diff(push[:, 0]) / np.diff(case.t))[rest].max()
    for share in (0.5, 0.7, 1.0):
        e = nsbench.errors(
            case,
            exact_run(
                case,
                contacts=((0, 0), (0, 1)),
                events=(),
                impulse=push * [share, 1 - share],
                reaction=push,
            ),
        )
        assert e["multipliers_unique"] is False
        assert all(np.isnan(e[k]) for k in ("impulse", "l1", "settled", "sup"))
        assert e["reaction"] < 1e-14 and e["polyhedron"] < 1e-12
        assert e["selection"] == pytest.approx((share - 0.5) * np.sqrt(2) * load, abs=1e-12)
    e = nsbench.errors(
        case,
        exact_run(case, contacts=((0, 0), (0, 1)), reaction=1.1 * push, impulse=push * [1.2, -0.1]),
    )
    assert e["polyhedron"] == pytest.approx(
        np.hypot(0.2, 0.1) * load, rel=1e-6
    )  # the nearest point is (1, 0)
    told = case.replace(
        exact_impulse=lambda t: TIDE.exact_impulse(t) * [0.5, 0.5]
    )  # a closed form that takes sides
    e = nsbench.errors(told, exact_run(told))
    assert np.isnan(e["impulse"]) and np.isnan(e["settled"]) and e["impulse_floor"] < 1e-13


def test_hexagonal_contacts_are_redundant_and_distances_to_the_set_are_right():
    case = get_case("hex")
    made = context_of(case)
    assert made.unique is False and context_of(TIDE).unique is True
    scene = ConstraintSet(case.problem, case.n)
    x = case.exact(case.t[-1:])[0]
    G = scene.dense_gradients(0.0, x, near_of(scene, made.active[-1]))
    assert G.shape[0] == 12 and np.linalg.matrix_rank(G) == 11
    poly = polyhedron(G, x, 1e-12)
    stress = poly.Z[:, 0]
    assert poly.Z.shape == (12, 1) and np.abs(stress @ G).max() < 1e-12
    pair = next(c for c in itertools.combinations(range(7), 2) if (0, *c) not in made.active[-1])
    run = exact_run(
        case,
        contacts=(*made.active[-1], (0, *pair)),
        events=(),
        impulse=np.outer(np.maximum(case.t - np.log(1.5), 0), [*poly.nearest(np.zeros(12)), 0.5]),
    )
    e = nsbench.errors(case, run)  # a contact that does not touch has no part in any solution
    assert e["polyhedron"] == pytest.approx(0.5) and e["selection"] == pytest.approx(0.5)
    # the set is a segment base + s stress: distances by hand
    lo = max(-poly.base[k] / stress[k] for k in range(12) if stress[k] > 0)
    hi = min(-poly.base[k] / stress[k] for k in range(12) if stress[k] < 0)
    rng = np.random.default_rng(4)
    for lam in rng.uniform(-3, 6, (20, 12)):
        s = np.clip(stress @ (lam - poly.base), lo, hi)
        assert np.abs(poly.nearest(lam) - poly.base - s * stress).max() < 1e-9


def test_the_nearest_multiplier_satisfies_its_optimality_conditions():
    rng = np.random.default_rng(7)
    for _ in range(30):
        m = rng.integers(3, 9)
        n = rng.integers(1, 4)
        G = rng.normal(size=(m, n))
        mu0 = np.maximum(rng.normal(size=m), 0)
        r = G.T @ mu0
        lam = 3 * rng.normal(size=m)
        mu = polyhedron(G, r, 1e-10).nearest(lam)
        assert np.abs(G.T @ mu - r).max() < 1e-9 and mu.min() > -2e-10
        # no feasible point is nearer: mu minimises (mu - lam) . z over the set
        best = linprog(mu - lam, A_eq=G.T, b_eq=r, bounds=(0, None))
        assert best.status == 3 or (mu - lam) @ mu <= best.fun + 1e-7
    assert polyhedron(np.eye(2), np.array([1.0, -1.0]), 1e-10).nearest(np.zeros(2)) is None


def test_rank_of_sparse_gradients_is_that_of_dense_ones():
    from scipy.sparse import block_diag, csr_array

    rng = np.random.default_rng(0)
    for _ in range(40):
        blocks = [rng.normal(size=(rng.integers(1, 4), rng.integers(1, 5))) for _ in range(3)]
        if rng.uniform() < 0.3:
            blocks[1] = np.vstack([blocks[1], blocks[1][0] * 2 + 1e-13])
        G = csr_array(block_diag(blocks))
        assert full_rank(G) == (np.linalg.matrix_rank(G.toarray(), tol=1e-10) == G.shape[0])


def test_candidates_by_id_are_those_of_the_scene():
    families = (
        Affine(np.eye(6)[:2], np.zeros(2)),
        Distance(1.0),
        Distance(2.0, anchors=np.ones((2, 2)), sign=-1),
        Distance(np.array([1.0, 2.0]), sign=-1, pairs=[[0, 1], [2, 1]]),
    )
    scene = ConstraintSet(Complementarity(lambda xp: lambda t, x: -x, families), 6)
    x = np.random.default_rng(1).normal(size=6)
    near = scene.near(x, np.inf)
    pick = [11, 3, 0, 7, 5]
    ids = [near.ids[k] for k in pick]
    again = near_of(scene, ids)
    assert again.ids == ids and np.array_equal(
        scene.gaps(0.0, x, again), scene.gaps(0.0, x, near)[pick]
    )
    assert near_of(scene, []).ids == []


def test_a_weight_of_one_up_to_rounding_is_that_of_one_side():
    field = get_case("sliding").problem
    weights = np.array([0.0, 1e-10, 0.5, 1.0 - 1e-10, 1.0])
    impulse = np.append(0.0, np.cumsum(weights))[:, None]
    assert pattern(field, np.arange(6.0), impulse)[:, 0].tolist() == [0, 0, 1, 2, 2]


def test_a_diode_is_active_at_the_samples_beside_intervals_in_which_it_conducts():
    case = get_case("rlc_diode")
    ref = context_of(case).ref
    acts = pattern(case.problem, case.t, ref.impulse)[:, 0] > 0
    assert acts.any() and not acts.all()
    beside = np.append(False, acts) | np.append(acts, False)
    assert context_of(case).active == tuple(((0, 0),) if b else () for b in beside)


def test_a_system_that_is_in_one_mode_all_the_time_breaks_no_sign():
    """The least part of an interval that a mode has is not below zero, and no more is said."""
    rest = {"on": lambda xp: lambda t, x: -x}
    far = Transition("on", lambda xp: lambda t, x: x[0] - 2.0, "on")
    case = Case("rest", Hybrid(rest, (far,)), np.ones(1), np.linspace(0.0, 1.0, 6))
    found = nsbench.errors(case, nsbench.solve(case, "event_driven"))
    assert found["sign"] == 0.0 and found["residual"] < 1e-9


def test_an_error_is_below_the_reference_as_far_as_that_can_have_made_it():
    """Of a sum over intervals, and of a rate over the shortest of them, twice the impulse's."""
    t = np.array([0.0, 0.5, 1.0, 2.0, 3.0])
    row = {f"{name}_floor": v for name, v in zip(FLOORS, (1.0, 2.0, 3.0, 4.0), strict=True)}
    limits = {"state_sup": 1.0, "state_T": 1.0, "impulse": 2.0, "reaction": 3.0, "event_time": 4.0}
    limits |= {"l1": 2 * 4 * 2.0, "settled": 2 * 2.0 / 0.5, "sup": 2 * 2.0 / 0.5}
    assert below_reference(row | limits, t) == []
    for name, limit in limits.items():
        assert below_reference(row | limits | {name: 0.999 * limit}, t) == [name]


def test_an_interval_with_an_event_inside_does_not_rest():
    frame = context_of(TIDE)
    rests = [k for k, *_ in _resting(frame)]
    assert len(rests) > 3
    for k in (rests[0], rests[2], rests[-1]):
        event = Event(float(TIDE.t[k : k + 2].mean()), "closes", (0, 0))
        ref = dataclasses.replace(frame.ref, events=(*frame.ref.events, event))
        found = [i for i, *_ in _resting(dataclasses.replace(frame, ref=ref, cache={}))]
        assert found == [i for i in rests if i != k]


def test_the_residual_is_the_largest_of_the_intervals():
    run = nsbench.solve(TIDE, "pbd", h=0.05)
    each = interval_residuals(context_of(TIDE), run)
    assert each.shape == (len(TIDE.t) - 1,)
    assert np.nanmax(each) == nsbench.errors(TIDE, run)["residual"] > 0.0
