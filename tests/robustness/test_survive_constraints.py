"""Constraints that leave no point, no direction or no start never end in a row that says ok."""

import numpy as np
import pytest
from survive_files import METHODS, case_file, refused_before, rows

import nsbench
from nsbench.diagnostics.contacts.infeasible_constraints import contradiction
from nsbench.problem import Affine, Complementarity, Smooth
from nsbench.solvers import solve

# constraints are what counts here: drifts need not be compiled
pytestmark = pytest.mark.usefixtures("interpreted")

PAIR = "Distance(2.0),"


@pytest.mark.survives("coincident centres")
@pytest.mark.parametrize(
    "methods", [METHODS, ("pbd[order=reverse]", "catching_up[backend=piqp]", "richardson")]
)
def test_coincident_centres_are_degenerate_whatever_the_method(tmp_path, methods):
    found = rows(case_file(tmp_path, "-x", PAIR, "[0.0, 0, 0, 0]", more='start="keep"'), methods)
    assert len(found) >= 3 and all(
        r["status"] == "degenerate" and "oincident centres" in r["why"] for r in found.values()
    )
    assert all(r["start"] == "kept" for r in found.values())


@pytest.mark.survives("coincident centres")
def test_coincident_centres_part_along_the_first_axis():
    case = nsbench.Case(
        "tie",
        Complementarity(lambda xp: lambda t, x: 0 * x, (nsbench.Distance(2.0),)),
        np.zeros(4),
        np.linspace(0, 1, 3),
        start="keep",
    )
    for spec in ("pbd", "catching_up", "penalty"):
        x = solve(case, spec).x[-1]
        assert x == pytest.approx([1.0, 0.0, -1.0, 0.0], abs=1e-3) and x[1] == x[3] == 0.0


@pytest.mark.survives("almost coincident")
@pytest.mark.parametrize("apart", ["1e-300", "1e-170", "1e-100", "1e-20"])
def test_centres_that_all_but_coincide_give_finite_numbers_or_no_ok(tmp_path, apart):
    found = rows(
        case_file(tmp_path, "-x", PAIR, f"[0.0, 0, {apart}, 0]", more='start="keep"'),
        ("pbd", "catching_up", "kdtree", "penalty"),
    )
    assert len(found) == 4 and all(r["status"] in ("ok", "degenerate") for r in found.values()), (
        found
    )
    assert all(
        np.isfinite(r["residual"]) and np.isfinite(r["feasibility"])
        for r in found.values()
        if r["status"] == "ok"
    )


@pytest.mark.survives("coincident centres", "infeasible start")
def test_no_start_can_be_projected_out_of_coincident_centres(tmp_path):
    found = rows(case_file(tmp_path, "-x", PAIR, "[0.0, 0, 0, 0]", more='start="project"'))
    assert len(found) == 5 and all(
        r["status"] == "degenerate" and "coincident centres" in r["why"] for r in found.values()
    )


@pytest.mark.survives("infeasible start")
@pytest.mark.parametrize("policy", ["error", "project", "keep"])
def test_a_start_outside_means_what_the_case_says_and_the_row_says_which(tmp_path, policy):
    found = rows(case_file(tmp_path, x0="[-1.0]", more=f'start="{policy}"'))
    expected = {"error": "error", "project": "ok", "keep": "ok"}[policy]
    assert len(found) >= 5 and {r["status"] for r in found.values()} == {expected}
    assert policy == "error" or {r["start"] for r in found.values()} == {
        {"project": "projected", "keep": "kept"}[policy]
    }
    assert policy != "error" or all(
        "violates constraint (0, 0) by 1" in r["why"] for r in found.values()
    )


@pytest.mark.survives("infeasible start")
def test_another_policy_is_an_error(tmp_path, capsys):
    assert "'perhaps'" in refused_before(
        case_file(tmp_path, more='start="perhaps"'), tmp_path, capsys
    )


@pytest.mark.survives("dependent constraints")
def test_a_wall_that_stands_there_three_times_pushes_once(tmp_path):
    case = nsbench.load_case(
        case_file(
            tmp_path,
            constraints="Affine(np.eye(1), np.zeros(1)), Affine(np.eye(1), np.zeros(1)), "
            "Affine(2 * np.eye(1), np.zeros(1)),",
        )
    )
    for spec in METHODS:
        traj = solve(case, spec)
        assert traj.status.ok and traj.reaction[-1, 0] == pytest.approx(1.0, abs=2e-2), spec
    assert not nsbench.errors(case, traj)["multipliers_unique"] or np.isnan(
        nsbench.errors(case, traj)["state_sup"]
    )


@pytest.mark.long
@pytest.mark.survives("dependent constraints")
@pytest.mark.parametrize(
    "spec", [m for m in METHODS if m != "kdtree"]
)  # which takes walls across coordinates only
def test_a_corner_of_three_walls_in_the_plane_holds_with_one_reaction(tmp_path, spec):
    """x >= 0, y >= 0, x + y >= 0, met in the corner at t = 1/2: three rows of rank 2. Exact: the
    drift (-1, -2) moves (1/2, 1) to the corner on a straight line, and there the walls bear all of
    it."""
    path = case_file(
        tmp_path,
        drift="xp.array([-1.0, -2.0]) + 0 * x",
        x0="[0.5, 1.0]",
        constraints="Affine(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]), np.zeros(3)),",
        more="exact=lambda t: np.outer(np.maximum(0.5 - t, 0.0), [1.0, 2.0])",
    )
    case = nsbench.load_case(path)
    traj = solve(case, spec)
    assert traj.status.ok
    bears = np.outer(
        np.maximum(case.t - 0.5, 0.0), [1.0, 2.0]
    )  # the drift, integrated from the corner on
    assert (
        np.abs(traj.x - case.exact(case.t)).max() < 2e-2
        and np.abs(traj.reaction - bears).max() < 4e-2
    )
    rows_of = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])[[c[1] for c in traj.contacts]]
    assert np.all(np.diff(traj.impulse, axis=0) >= -1e-12)
    assert traj.impulse @ rows_of == pytest.approx(traj.reaction, abs=1e-9)
    row = rows(path, (spec,))[spec]
    assert row["status"] in ("ok", "below_reference") and not row["multipliers_unique"]
    assert np.isnan(row["impulse"]) and row["reaction"] < 4e-2


BETWEEN = "Affine(np.array([[1.0], [-1.0]]), {}),"
TRIANGLE = "Affine(np.array([[1.0, 0], [0, 1], [-1, -1]]), np.array([-1.0, -1.0, 1.0])),"


@pytest.mark.long
@pytest.mark.survives("empty set")
@pytest.mark.parametrize(
    "constraints, x0, policy",
    [
        (BETWEEN.format("np.array([-1.0, 0.0])"), "[0.5]", "keep"),
        (BETWEEN.format("np.array([-1.0, 0.0])"), "[0.5]", "project"),
        (BETWEEN.format("lambda xp: lambda t: xp.stack((-t, 1.0 - t))"), "[0.5]", "error"),
        (TRIANGLE, "[0.0, 0.0]", "keep"),
    ],
)
def test_walls_that_leave_no_point_are_infeasible_whatever_the_method(
    tmp_path, constraints, x0, policy
):
    found = rows(case_file(tmp_path, "0 * x", constraints, x0, more=f'start="{policy}"'))
    assert len(found) >= 4 and {r["status"] for r in found.values()} == {"infeasible"}, found
    assert all(len(r["why"].split()) > 5 for r in found.values())


@pytest.mark.survives("short chain")
@pytest.mark.parametrize("policy", ["keep", "project"])
def test_a_chain_that_cannot_span_its_anchors_is_infeasible(tmp_path, policy):
    links = (
        "Distance(1.0, sign=-1, pairs=[[0, 1]]), "
        "Distance(0.1, sign=-1, pairs=[[0, 0], [1, 1]], anchors=np.array([[0.0, 0], [3, 0]])),"
    )
    found = rows(case_file(tmp_path, "-x", links, "[0.0, 0, 3, 0]", more=f'start="{policy}"'))
    assert len(found) >= 3 and {r["status"] for r in found.values()} == {"infeasible"}, found


def test_sets_that_have_a_point_are_not_called_empty():
    """Walls that touch, links that are just long enough, many rows of which none contradicts
    another."""
    rng = np.random.default_rng(0)
    A = rng.standard_normal((40, 7))
    rest = lambda xp: lambda t, x: 0 * x
    for family, n in (
        (Affine(np.array([[1.0], [-1.0]]), np.array([0.0, 0.0])), 1),
        (Affine(A, 1e-9 - A @ np.ones(7)), 7),
    ):
        problem = Complementarity(rest, (family,))
        assert (
            contradiction(
                nsbench.Case("made", problem, 9.0 * np.ones(n), [0.0, 1.0], start="keep"), 0.0
            )
            is None
        )
    for d, empty in ((1.0, False), (0.9999, True)):
        links = (
            nsbench.Distance(d, sign=-1, pairs=[[0, 1]]),
            nsbench.Distance(
                1.0, sign=-1, pairs=[[0, 0], [1, 1]], anchors=np.array([[0.0, 0], [3, 0]])
            ),
        )
        case = nsbench.Case(
            "made", Complementarity(rest, links), np.zeros(4), [0.0, 1.0], start="keep"
        )
        assert (contradiction(case, 0.0) is not None) == empty


@pytest.mark.long
@pytest.mark.survives("no gradient")
@pytest.mark.parametrize("g", ["x**3", "1.0 * x * x * x * x * x"])
def test_a_constraint_without_a_direction_is_degenerate_whatever_the_method(tmp_path, g):
    found = rows(case_file(tmp_path, constraints=f"Smooth(lambda xp: lambda t, x: {g}),"))
    assert len(found) >= 4 and {r["status"] for r in found.values()} == {"degenerate"}, found


def test_a_smooth_wall_with_a_gradient_is_not_degenerate():
    case = nsbench.Case(
        "made",
        Complementarity(
            lambda xp: lambda t, x: xp.stack((1.0 + 0 * x[0], -1.0 + 0 * x[0])),
            (Smooth(lambda xp: lambda t, x: xp.stack((x[1] - xp.sin(x[0]),))),),
        ),
        np.array([0.0, 1.0]),
        np.linspace(0, 2, 11),
    )
    for spec in ("pbd", "catching_up", "event_driven"):
        assert solve(case, spec).status.ok


@pytest.mark.long
@pytest.mark.survives("empty set")
@pytest.mark.parametrize(
    "spec, closing, dim, fits",
    [
        (spec, closing, dim, fits)
        for closing, dim, fits in (
            (0.3, 1, True),
            (0.9, 1, False),
            (0.58, 2, True),
            (1.4, 2, False),
        )
        for spec in ("pbd", "richardson", "catching_up", "penalty", "event_driven")
        + ("pbd[order=reverse]", "pbd[order=random,seed=1]") * (dim == 2)
    ],
)
def test_walls_that_close_in_on_discs_leave_no_room_at_some_time(spec, closing, dim, fits):
    """Three discs in a row of length 2, or in a box as high as one: centres between -L and L, L =
    1.6 - closing t."""
    walls = Affine(
        np.kron(np.eye(3), np.eye(dim)[:1]), lambda xp: lambda t: (1.6 - closing * t) * xp.ones(3)
    )
    other = Affine(
        -np.kron(np.eye(3), np.eye(dim)[:1]), lambda xp: lambda t: (1.6 - closing * t) * xp.ones(3)
    )
    lids = tuple(
        Affine(s * np.kron(np.eye(3), np.eye(dim)[1:]), 0.05 * np.ones(3))
        for s in (1.0, -1.0)
        if dim == 2
    )
    x0 = np.array([[-1.2, 0.0, 1.2], [0.0, 0.03, -0.02]])[:dim].T.ravel()
    case = nsbench.Case(
        "closing",
        Complementarity(
            lambda xp: lambda t, x: -0.1 * x, (nsbench.Distance(1.0, dim=dim), walls, other, *lids)
        ),
        x0,
        np.linspace(0, 1, 9),
    )
    method = nsbench.solvers.get(spec)
    for value in {"h": (0.03, 0.003), "k": (300.0, 3000.0), "tol": (1e-8,)}[method.accuracy]:
        status = solve(case, spec, **{method.accuracy: value}).status
        assert status.code == ("ok" if fits else "infeasible"), status
