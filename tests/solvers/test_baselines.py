"""What users would write themselves gives the right answers: as accurate as it claims, and told
apart from the bench."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import nsbench
from nsbench import solvers
from nsbench.case import case_names, get_case
from nsbench.solvers.kdtree.method import _jacobi
from nsbench.solvers.solve_ivp.method import _event, _march, find_script
from nsbench.study.plan import suite_cases

FULL = [
    k
    for k in dict.fromkeys(suite_cases("full"))
    if solvers.get("solve_ivp").refuses(get_case(k)) is None
]
MODES = {k for k in case_names() if solvers.get("solve_ivp").refuses(get_case(k)) is None}
SLOW = {"stiff_contact[K=10000]"}  # 2 s: explicit steps at the limit of stability


def test_modes_are_written_by_hand_for_the_cases_that_rank_methods():
    assert {k.split("[")[0] for k in FULL} >= {
        "slide_exit",
        "oscillator",
        "stick_slip",
        "friction",
        "three_discs",
        "tide",
        "apple",
        "two_discs",
        "circle_sliding",
        "graze",
        "obstacle",
        "play",
        "moving_floor",
        "wedge",
        "two_surfaces",
    }


@pytest.mark.long
@pytest.mark.parametrize("key", [k for k in FULL if k not in SLOW])
def test_modes_written_by_hand_reach_their_bound_and_the_same_events(key):
    case = get_case(key)
    traj = nsbench.solve(case, "solve_ivp")
    e = nsbench.errors(case, traj)
    assert traj.status.ok and e["state_sup"] <= solvers.get("solve_ivp").claims.exact
    # at rest under dry friction the weight is x / (2 mu): its integral magnifies an error of the
    # state by up to 100
    assert e["impulse"] <= 1e-9 and not e["events_missed"] and not e["events_extra"]
    assert np.isnan(e["event_time"]) or e["event_time"] <= 1e-10
    assert e["residual"] <= 1e-9, "the reaction balances the equation"


@pytest.mark.parametrize("method", ["lsoda", "radau"])
@pytest.mark.parametrize("key", ["slide_exit", "two_discs[w=1]", "friction"])
def test_other_integrators_reach_their_bounds(key, method):
    spec = f"solve_ivp[method={method}]"
    traj = nsbench.solve(get_case(key), spec)
    assert nsbench.errors(get_case(key), traj)["state_sup"] <= solvers.get(spec).claims.exact
    assert traj.stats["drift_calls"] < 10_000, (
        "a method of order 3 needs a hundred thousand and more"
    )


def test_an_event_that_leaves_the_arc_as_it_is_is_not_recorded():
    """The parabola that touches the floor in one point: nothing happens there, whether the step
    sees it or not."""
    case = get_case("graze")
    floor = find_script(get_case("graze"))
    for step in (np.inf, 1e-2):
        work = dataclasses.replace(floor, max_step=step)
        arcs = {name: (arc, [_event(e) for e in arc.exits]) for name, arc in work.arcs.items()}
        lower = lambda t, y, when=floor.arcs["free"].exits[0].when: when(t, y) - 1e-3
        # met on the way up, where the point stays free
        lower.terminal = True
        lower.direction = 1
        arcs["free"][1][0] = lower
        assert _march(case, work, arcs, solve_ivp, "DOP853", 1e-10).events == ()


def test_a_tolerance_of_solve_ivp_does_what_it_says():
    case = get_case("slide_exit")
    found = [
        nsbench.errors(case, nsbench.solve(case, "solve_ivp", tol=tol))["state_sup"]
        for tol in (1e-5, 1e-8, 1e-11)
    ]
    assert found[0] > 30 * found[1] > 900 * found[2]
    for bad in (1e-15, 0.5):
        with pytest.raises(ValueError, match="tol is"):
            nsbench.solve(case, "solve_ivp", tol=bad)


def changed(name, **data):
    case = get_case(name)
    p = case.problem
    if isinstance(p, nsbench.Filippov):
        return case.replace(
            problem=nsbench.Filippov.signs(data.get("field", p.field), data.get("switch", p.switch))
        )
    return case.replace(
        problem=nsbench.Complementarity(
            data.get("drift", p.drift), data.get("constraints", p.constraints)
        )
    )


@pytest.mark.parametrize(
    "case, word",
    [
        (get_case("tide").replace(x0=np.array([0.6])), "start"),
        (
            changed("tide", drift=lambda xp: lambda t, x: -xp.cos(t) * xp.ones_like(x) + 1e-12),
            "drift",
        ),
        (
            changed("tide", constraints=(nsbench.Affine(np.eye(1), np.array([1e-9])),)),
            "constraints",
        ),
        (changed("two_discs", constraints=(nsbench.Distance(d=1.9),)), "constraints"),
        (
            changed(
                "play",
                constraints=(
                    nsbench.Affine([[1.0], [-1.0]], lambda xp: lambda t: xp.array([1.0, 1.0]) + t),
                ),
            ),
            "constraints",
        ),
        (changed("oscillator", switch=lambda xp: lambda t, x: x[0:1] - 0.5), "switch"),
        (get_case("slide_exit").replace(name="tide"), "kind"),
        (get_case("hex"), "Nobody"),
        (get_case("tide").replace(name="mine"), "Nobody"),
        (get_case("three_discs", overlap="keep"), "Nobody"),
    ],
)
def test_modes_are_refused_for_any_other_problem(case, word):
    why = solvers.get("solve_ivp").refuses(case)
    assert why and word in why and why.endswith((".", ")."))
    assert nsbench.solve(case, "solve_ivp").status.code == "refused"


STEPS = np.array([8, 11, 17, 26, 41, 67])


@pytest.mark.long
@pytest.mark.parametrize("spec", ["kdtree", "kdtree[margin=0.2]", "kdtree[sweep=numpy]"])
@pytest.mark.parametrize(
    "key", ["two_discs", "three_discs", "discs[n=10,seed=0]", "box_turning[side=0.8]"]
)
def test_kdtree_has_the_order_it_claims(key, spec):
    case = get_case(key)
    found = []
    for n in STEPS:
        traj = nsbench.solve(case, spec, h=float(np.diff(case.t).min()) / n)
        e = nsbench.errors(case, traj)
        assert traj.status.ok
        found.append(
            [
                traj.stats["h"],
                e["state_sup"],
                e["impulse" if e["multipliers_unique"] else "reaction"],
            ]
        )
    h, state, force = np.log(np.array(found).T)
    claims = solvers.get(spec).claims
    # ten discs under Jacobi steps are 0.06 off at the last step: their first steps are not
    # asymptotic
    room = 0.15 if key.startswith("discs") and "numpy" in spec else 0.05
    assert abs(np.polyfit(h, state, 1)[0] - claims.state) < room
    assert abs(np.polyfit(h, force, 1)[0] - claims.impulse) < room


def test_kdtree_without_a_second_contact_is_pbd():
    """Two discs and a box leave nothing to the order of the sweep or to the search: equal to
    rounding, impulses too."""
    for key in ("two_discs[w=1]", "box_turning[side=0.8]"):
        a, b = (nsbench.solve(get_case(key), s, h=0.01) for s in ("kdtree", "pbd"))
        assert np.abs(a.x - b.x).max() < 1e-12 and np.abs(a.reaction - b.reaction).max() < 1e-12
        order = [a.contacts.index(c) for c in b.contacts]
        assert (
            set(a.contacts) == set(b.contacts)
            and np.abs(a.impulse[:, order] - b.impulse).max() < 1e-12
        )


def test_a_jacobi_step_divides_a_pair_by_its_larger_number_of_contacts():
    """Three discs of diameter 2 in a row, 1.9 apart: each pair would part by 0.1, each gets half of
    it."""
    x = np.array([[0.0, 0.0], [1.9, 0.0], [3.8, 0.0]])
    impulse = np.empty(2)
    _jacobi(x, np.array([[0, 1], [1, 2]]), 2.0, impulse)
    assert (
        np.abs(impulse - 0.025).max() < 1e-15
        and np.abs(x[:, 0] - [-0.025, 1.9, 3.825]).max() < 1e-15
    )


def test_kdtree_starts_where_pbd_does():
    case = get_case("three_discs", overlap="project")
    a, b = (nsbench.solve(case, s, h=0.01).x[0] for s in ("kdtree", "pbd"))
    assert np.array_equal(a, b) and np.abs(a - case.x0).max() > 0.1
    with pytest.raises(ValueError, match="violates"):
        nsbench.solve(case.replace(start="error"), "kdtree")


def test_kdtree_keeps_discs_and_walls_of_a_box_apart():
    case = get_case("discs", n=30, box=True)
    traj = nsbench.solve(case, "kdtree[margin=0.1]", h=1e-3)
    e = nsbench.errors(case, traj)
    assert traj.status.ok and e["feasibility"] < 0.05 and e["sign"] >= 0.0 and e["residual"] < 0.05
    assert {c[0] for c in traj.contacts} == {0, 1}, "pairs and walls both acted"


@pytest.mark.parametrize(
    "key, word",
    [
        ("slide_exit", "none"),
        ("smooth", "none"),
        ("epithelium", "one family"),
        ("wedge", "walls"),
        ("play", "walls"),
        ("stack", "walls"),
        ("chain", "one family"),
        ("obstacle", "one family"),
        ("relay_lcs", "none"),
    ],
)
def test_kdtree_refuses_what_it_would_get_wrong(key, word):
    why = solvers.get("kdtree").refuses(get_case(key))
    assert why is None or (len(why.split()) > 4 and why.endswith((".", ").")))
    assert why and word in why


@pytest.mark.parametrize("spec", ["solve_ivp", "kdtree", "kdtree[sweep=numpy]"])
@pytest.mark.parametrize("name", case_names())
def test_a_baseline_takes_a_case_or_refuses_with_a_sentence(spec, name):
    why = solvers.get(spec).refuses(get_case(name))
    assert why is None or (len(why.split()) > 4 and why.endswith((".", ").")))


def test_a_drift_that_is_no_number_ends_kdtree_with_a_status():
    def later(xp):
        def f(t, x):
            return 0.0 * xp.sqrt(1.0 - t) - x

        return f

    case = changed("two_discs", drift=later)
    with np.errstate(all="ignore"):
        traj = nsbench.solve(case, "kdtree")
    assert traj.contacts == ((0, 0, 1),), "the discs met before"
    assert traj.status.code == "nan" and "t = 1" in str(traj.status)
    assert (
        np.isfinite(traj.x[0]).all()
        and np.isnan(traj.x[-1]).all()
        and np.isnan(traj.impulse[-1]).all()
    )


def test_options_out_of_range_are_errors():
    for spec in ("solve_ivp[method=rk45]", "kdtree[sweep=rust]", "kdtree[margin=-1]"):
        with pytest.raises(ValueError, match="is"):
            solvers.get(spec)


def needs_nosnoc():
    pytest.importorskip(
        "casadi", reason="casadi and nosnoc are an extra: pip install nsbench[nosnoc]"
    )
    pytest.importorskip("nosnoc", reason="nosnoc is an extra: pip install nsbench[nosnoc]")


@pytest.mark.parametrize("name", case_names())
def test_nosnoc_takes_a_case_or_refuses_with_a_sentence(name):
    why = solvers.get("nosnoc").refuses(get_case(name))
    assert why is None or (len(why.split()) > 4 and why.endswith((".", ")")))


def test_nosnoc_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(
        solvers.get("nosnoc").refuses.__globals__["importlib"].util, "find_spec", lambda name: None
    )
    assert "pip install" in solvers.get("nosnoc").refuses(get_case("tide"))
    assert "neither" in solvers.get("nosnoc").refuses(get_case("smooth")), (
        "what it cannot do comes first"
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "spec, key, bound",
    [
        ("nosnoc[stages=2]", "slide_exit", 1e-4),
        ("nosnoc", "oscillator", 1e-5),
        ("nosnoc", "two_discs", 1e-8),
        ("nosnoc[stages=2]", "tide", 1e-5),
    ],
)
def test_nosnoc_is_as_accurate_as_its_order_and_tolerance_allow(spec, key, bound):
    """Stewart's form and the step form, weights, impulses and reactions; the bounds are three times
    what was seen."""
    needs_nosnoc()
    case = get_case(key)
    traj = nsbench.solve(case, spec)
    e = nsbench.errors(case, traj)
    assert (
        traj.status.ok
        and e["state_sup"] < bound
        and e["impulse"] < bound
        and not e["reaction"] > bound
    )
    assert e["residual"] < 1e-6


@pytest.mark.long
def test_nosnoc_has_the_order_of_its_radau_method():
    needs_nosnoc()
    case = get_case("oscillator")
    found = []
    for n in (1, 2):
        traj = nsbench.solve(case, "nosnoc[stages=2]", h=float(case.t[1]) / n)
        found.append([traj.stats["h"], nsbench.errors(case, traj)["state_sup"]])
    h, err = np.log(np.array(found).T)
    assert abs(np.polyfit(h, err, 1)[0] - solvers.get("nosnoc[stages=2]").claims.state) < 0.3


def test_nosnoc_refuses_functions_that_leave_the_namespace():
    needs_nosnoc()
    for drift in (
        lambda xp: lambda t, x: -x if x[0] > 0.5 else x,
        lambda xp: lambda t, x: xp.array([float(x[0])]),
    ):
        assert "casadi cannot" in solvers.get("nosnoc").refuses(changed("tide", drift=drift))


def test_nosnoc_says_when_its_push_is_too_weak():
    needs_nosnoc()
    case = get_case("stiff_contact")  # lam grows to 100
    assert nsbench.solve(case, "nosnoc[stages=1]", h=0.5).status.code == "infeasible"


def test_documentation_names_every_script_that_measures_speed():
    root = Path(__file__).parents[2]
    speed = (root / "docs" / "speed.md").read_text(encoding="utf-8")
    methods = (root / "docs" / "methods.md").read_text(encoding="utf-8")
    scripts = sorted(p.name for p in (root / "tests" / "studies" / "speed").glob("*.py"))
    assert scripts and not [s for s in scripts if f"`{s}`" not in speed]
    assert f"the modes of {len(MODES)} cases" in methods


def test_nosnoc_does_not_go_on_for_ever(monkeypatch):
    needs_nosnoc()
    from nsbench.solvers.nosnoc import method as nosnoc

    monkeypatch.setattr(nosnoc, "LABOUR", 5)
    monkeypatch.setattr(nosnoc, "FIRST", 50)
    run = nsbench.solve("slide_exit", "nosnoc", h=0.1)
    assert run.status.code == "maxiter" and "iterations for the" in str(run.status)
    assert 50 < run.stats["inner_iterations"] < 500


def test_nosnoc_tells_of_a_switch_that_its_tolerance_hides():
    needs_nosnoc()
    case = get_case("slide_exit")
    problem = nsbench.Filippov.signs(
        case.problem.field, lambda xp: lambda t, x: 1e-14 * case.problem.switch(xp)(t, x)
    )
    flat = case.replace(problem=problem, exact=None, exact_impulse=None, exact_events=None)
    run = nsbench.solve(flat, "nosnoc", h=0.1)
    assert run.status.code == "maxiter" or (
        run.status.code == "unverified" and "comp_tol" in str(run.status)
    )
