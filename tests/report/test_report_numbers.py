"""What the report says of orders and costs follows from the rows: claims, bounds, floors, factors
at equal error."""

import numpy as np
import pytest
from report_rows import SOLVERS, STEPS, row, summaries

from nsbench.report import cost as speed
from nsbench.report import data, euler_sliding_figure, overview, style, summary, verdict
from nsbench.report.answers import choices
from nsbench.report.tables import equal_error_tables, order_table, reliability_tables
from nsbench.solvers import get
from nsbench.trajectory import STATUSES


@pytest.mark.survives("two steps", "error zero")
def test_two_steps_are_no_order_and_zeros_are_exact():
    few = summaries([row("a", "pbd", h, state_sup=h, impulse=0.0) for h in (0.1, 0.05)])["a", "pbd"]
    assert (
        few.state.kind == "level"
        and "order needs 3" in few.state.sentence
        and few.state.best == 0.05
    )
    zero = summaries([row("a", "pbd", float(h), state_sup=0.0, impulse=1e-15) for h in STEPS])[
        "a", "pbd"
    ]
    assert zero.state.kind == zero.force.kind == "exact"
    assert order_table.order_cell(zero.force).small == "exact at grid times"


@pytest.mark.parametrize("p, flag", [(0.5, "below"), (1.0, ""), (2.0, "above"), (-1.0, "below")])
def test_a_deviation_from_the_claim_is_marked_in_either_direction(p, flag):
    rng = np.random.default_rng(3)
    rows = [
        row("a", "pbd", float(h), state_sup=float(h**p * np.exp(0.02 * rng.standard_normal())))
        for h in STEPS
    ]
    state = summaries(rows)["a", "pbd"].state
    assert state.flag == flag and abs(state.order - p) < 0.02
    assert summaries(rows, {})["a", "pbd"].state.flag == ""


def test_rounding_that_an_extrapolation_enlarges_is_no_plateau():
    """2 x(h/2) - x(h) carries five times the rounding of one addition per step: errors that level
    off there are none."""
    h = 0.1 / np.unique(np.round(300 * 2 ** np.arange(0, 8, 0.3)))
    noise = 2.5 * (1e-12 + np.finfo(float).eps / h)
    rows = [
        row("a", "pbd", float(v), state_sup=float(max(1e3 * v**3, e)))
        for v, e in zip(h, noise, strict=True)
    ]
    plain, known = (
        summaries(rows, {"pbd": {"accuracy": "h", "claims": {"state": 2.0} | more}})[
            "a", "pbd"
        ].state
        for more in ({}, {"rounding": 5.0})
    )
    assert (
        plain.best_h
        and known.window[0] > 3 * plain.window[0]
        and known.order == pytest.approx(3.0, abs=0.05)
    )
    assert get("richardson").claims.rounding == 5.0 and get(
        "richardson[levels=3]"
    ).claims.rounding == pytest.approx(15.0)


@pytest.mark.survives("coarse reference")
def test_errors_below_the_reference_are_not_numbers():
    rows = [
        row(
            "a",
            "pbd",
            float(h),
            state_sup=float(1e-9 * h),
            state_floor=1e-9,
            status="below_reference",
        )
        for h in STEPS
    ]
    s = summaries(rows)["a", "pbd"]
    assert s.state.kind == "level" and summary.format_best_error(s, s.state) == "< 1e-9 (reference)"


def test_a_claimed_bound_that_is_missed_in_silence_is_called_so():
    solvers = {"event_driven": SOLVERS["event_driven"]}
    good, bad = (
        summaries([row("a", "event_driven", 1e-10, "tol", state_sup=e)], solvers)
        for e in (1e-11, 1e-7)
    )
    assert not summary.find_silent_failures(good) and len(summary.find_silent_failures(bad)) == 1
    assert (
        good["a", "event_driven"].state.flag == ""
        and bad["a", "event_driven"].state.flag == "below"
    )
    said = verdict.write_verdict(
        data.read([row("a", "event_driven", 1e-10, "tol", state_sup=1e-7)]), bad
    )
    assert any(s.head == "Wrong without a word" for s in said)


def runs(errors, h=(0.1, 0.05, 0.025, 0.0125), seconds=None, **more):
    seconds = [1 / v for v in h] if seconds is None else seconds
    rows = [
        row("a", "pbd", v, state_sup=e, seconds=s, drift_calls=1 / v, **more)
        for v, e, s in zip(h, errors, seconds, strict=True)
    ]
    return data.read(rows).runs["a", "pbd"]


def test_cost_at_equal_error_interpolates_and_takes_no_lucky_dip():
    h = (0.1, 0.05, 0.025, 0.0125)
    c = speed.cost_at_error(runs(h), 0.03)
    assert (
        c.h == pytest.approx(0.03)
        and c.seconds == pytest.approx(1 / 0.03)
        and c.work == pytest.approx(1 / 0.03)
    )
    assert speed.cost_at_error(runs((0.1, 1e-9, 0.025, 0.0125)), 0.02).h == pytest.approx(0.02)
    assert speed.cost_at_error(runs(h), 1e-3) is None and speed.cost_at_error(runs(h), 0.5).at_most
    assert speed.cost_at_error(runs((0.1, 0.0, 0.0, 0.0)), 1e-6).h == pytest.approx(0.05)


def test_seconds_are_compared_between_loops_of_one_kind_only():
    base, host = (
        speed.cost_at_error(runs((0.1, 0.05, 0.02, 0.01), loop=loop), 0.03)
        for loop in ("compiled", "host")
    )
    assert (
        speed.ratio_of_seconds(base, base) == 1.0
        and speed.ratio_of_seconds(host, base) is None
        and speed.ratio_of_work(host, base) == 1.0
    )
    coarse = speed.cost_at_error(runs((0.1, 0.05, 0.02, 0.01)), 0.5)
    assert speed.ratio_of_seconds(coarse, base) is None
    assert speed.most_ratio_of_seconds(coarse, base) == coarse.seconds / base.seconds
    assert speed.most_ratio_of_seconds(base, coarse) is None


@pytest.mark.parametrize("times, said", [(6.0, "was not seen"), (300.0, "was seen")])
def test_the_factor_of_100_is_computed_from_the_rows(times, said):
    rows = []
    for solver, cost in (("pbd", 1e-6), ("catching_up", 1e-6 * times)):
        rows += [
            row(
                "a",
                solver,
                float(h),
                state_sup=float(h),
                seconds=cost / h,
                qp_solves=float(solver != "pbd"),
            )
            for h in STEPS
        ]
    told = " ".join(speed.compare_speeds(data.read(rows)))
    assert f"{said} at equal error" in told and f"takes {style.format_factor(times)} times" in told


def test_the_cheapest_method_depends_on_the_rows():
    rows = [
        row("a", s, float(h), state_sup=float(h), seconds=c / h)
        for s, c in (("pbd", 2.0), ("catching_up", 1.0))
        for h in STEPS
    ]
    read = data.read(rows)
    cell = equal_error_tables.choice_table(read, summary.summarise(read)).rows[0].cells[1]
    assert cell.text == "catching_up" and "pbd" in cell.title


@pytest.mark.parametrize("loop", ["compiled", "host"])
def test_a_run_that_reaches_the_error_is_best_and_an_extrapolation_is_named_beside_it(loop):
    """PBD stops above the error, and would take 3 ms for it."""
    rows = [
        row("a", "pbd", float(h), state_sup=30.0 * h, seconds=1e-7 / h, loop="compiled")
        for h in STEPS
    ]
    rows += [row("a", "event_driven", 1e-12, state_sup=1e-15, loop=loop)]
    at = 1 + speed.TARGETS.index(overview.TARGET)
    for seconds in (3e-2, 3e-4):
        rows[-1]["seconds"] = seconds
        read = data.read(rows)
        found = summary.summarise(read)
        cell = equal_error_tables.choice_table(read, found).rows[0].cells[at]
        ranks = equal_error_tables.ranking_table(read, found).rows
        line = overview.overview(read)[0]
        first = choices.write_headline(read, found)
        assert cell.text == line.best == "event_driven" and "extrapolated" not in line.setting
        assert f"the cheapest is event_driven (h = {line.setting[4:]}, " in first
        won = {r.solver: r.cells[at].small for r in ranks}
        assert won["event_driven"] == "cheapest on 1" and won["pbd"].startswith("needs h = 3.3e-5")
        assert [" pbd " in text for text in (cell.small, first)] == [seconds > 3e-3] * 2


def test_where_no_run_reaches_the_error_all_name_the_same_extrapolation():
    rows = [
        row("a", "pbd", float(h), state_sup=30.0 * h, impulse=2.0 * h, seconds=1e-7 / h)
        for h in STEPS
    ]
    read = data.read(rows)
    found = summary.summarise(read)
    cell = equal_error_tables.choice_table(read, found).rows[0].cells[
        1 + speed.TARGETS.index(overview.TARGET)
    ]
    (line,) = overview.overview(read)
    first = choices.write_headline(read, found)
    assert cell.text == line.best == "pbd" and line.setting.endswith(", extrapolated")
    assert "reached by no run; best by its order is pbd" in first
    assert line.setting.removesuffix(", extrapolated") in cell.small
    assert line.setting.removesuffix(", extrapolated") in first
    assert line.order.startswith("1.00 [") and line.multipliers.startswith("order 1.00 [")


def test_a_host_loop_with_fewer_seconds_is_the_cheapest():
    rows = [
        row("a", "pbd", float(h), state_sup=0.1 * h, seconds=1e-3 / h, loop="compiled")
        for h in STEPS
    ]
    rows += [row("a", "event_driven", 1e-12, state_sup=1e-15, loop="host")]
    for seconds, best in ((1e-2, "event_driven"), (1e2, "pbd")):
        rows[-1]["seconds"] = seconds
        read = data.read(rows)
        cells = equal_error_tables.choice_table(read, summary.summarise(read)).rows[0].cells
        assert cells[1 + speed.TARGETS.index(1e-3)].text == overview.overview(read)[0].best == best
        headline = choices.write_headline(read, summary.summarise(read))
        assert f"the cheapest is {best} " in headline


@pytest.mark.parametrize(
    "value, said",
    [
        (0.0, "0"),
        (3e-4, "3e-4"),
        (2.98e-4, "3.0e-4"),
        (0.012, "0.012"),
        (0.198, "0.20"),
        (9999.0, "1.0e4"),
        (1234.0, "1200"),
        (-0.5, "-0.5"),
        (np.nan, "not finite"),
        (9.96e-3, "0.010"),
        (1e-12, "1e-12"),
    ],
)
def test_numbers_read_as_people_type_them(value, said):
    assert style.format_number(value) == said


def test_methods_keep_their_look_and_variants_share_a_colour():
    look = style.assign_looks(
        ["pbd", "catching_up", "pbd[order=reverse]", *[f"m{i}" for i in range(12)]]
    )
    assert look["pbd"].colour == look["pbd[order=reverse]"].colour != look["catching_up"].colour
    assert len({(v.tone, v.marker, v.line) for v in look.values()}) == len(look)
    # lines without markers: performance profiles
    variants = ("", "[order=reverse]", "[order=random,seed=2]", "[order=random,seed=5]", "[tol=1e-2]")
    five = style.assign_looks([f"pbd{v}" for v in variants]).values()
    assert len({v.line for v in five}) == 5


def test_the_distance_from_the_exact_path_is_that_of_the_polygon():
    path = np.array([[0.0, 1.0], [0.0, 0.0], [2.0, 0.0]])
    assert euler_sliding_figure.largest_distance(
        np.array([[1.0, 0.3], [0.1, 0.5], [1.5, -0.2]]), path
    ) == pytest.approx(0.3)
    assert euler_sliding_figure.largest_distance(np.array([[3.0, 0.0]]), path) == pytest.approx(1.0)


def test_a_slope_of_scatter_is_no_number_to_show():
    """Errors thrown over 16 decades: a line goes through them, but neither its slope nor its
    constant is one of a method."""
    rng = np.random.default_rng(1)
    rows = [
        row("a", "pbd", float(h), state_sup=float(10.0 ** rng.uniform(-16.0, 0.0))) for h in STEPS
    ]
    state = summaries(rows)["a", "pbd"].state
    assert (
        state.kind == "level"
        and state.verdict in summary.OPEN
        and not np.isfinite([state.order, state.constant]).any()
    )
    assert order_table.order_cell(state).text == state.verdict


def test_no_error_below_its_floor_is_a_number_beside_an_order():
    """Multipliers without order, times of events, and the terminal's table."""
    near = {"impulse_floor": 2e-12, "event_floor": 3e-13, "state_floor": 1e-13, "state_scale": 1.0}
    rows = [
        row("a", "event_driven", tol, "tol", state_sup=1e-15, impulse=9e-16, **near)
        | {"event_time": 2e-16, "events": 133.0, "seconds": 1e-3}
        for tol in (1e-8, 1e-10, 1e-12)
    ]
    found = summaries(rows)["a", "event_driven"]
    texts = [c.small for c in order_table.orders_table({("a", "event_driven"): found}).rows[0].cells]
    assert "best < 2e-12" in texts and "times to < 3e-13" in texts
    pairs = {("a", "event_driven"): found}
    table = reliability_tables.bounds_table(data.read(rows), pairs)
    assert "133" in [c.text for c in table.rows[0].cells]
    (line,) = overview.overview(data.read(rows))
    assert line.multipliers == "to < 2e-12"


def test_an_unverified_run_is_no_failure():
    rows = [
        row("a", "pbd", 2.0**-k, status=status, state_sup=0.1, why="x")
        for k, status in enumerate(STATUSES)
    ]
    read = data.read([*rows, *rows[1:2]])
    (line,) = overview.overview(read)
    assert (line.unverified, line.failed) == (2, len(STATUSES) - 4)
    assert dict(zip(overview.HEAD, line.cells(), strict=True))["unverified"] == "2"
    said = " ".join(str(s) for s in verdict.write_verdict(read, summary.summarise(read)))
    assert f"2 unverified, {len(STATUSES) - 4} failed: " in said
    doubted = summary.summarise(data.read([*rows[:1], *rows[1:2]]))
    said = " ".join(str(s) for s in verdict.write_verdict(data.read(rows[:2]), doubted))
    assert "1 unverified, none failed" in said and "failed at some" not in said


def test_a_constant_without_a_verdict_is_marked_so():
    rng = np.random.default_rng(0)
    rows = [
        row("a", "pbd", float(h), state_sup=float(h**1.5 * rng.uniform(0.6, 1.6))) for h in STEPS
    ]
    found = summaries(rows)["a", "pbd"]
    assert found.state.kind == "fit" and found.state.verdict in summary.OPEN
    cells = order_table.orders_table({("a", "pbd"): found}).rows[0].cells
    assert cells[2].small == found.state.verdict and cells[2].kind == "quiet"


def told(head, rows, cases=None):
    """The sentences of the report's opening under a heading."""
    known = data.read(rows)
    known.cases.update(cases or {})
    known.solvers.update(SOLVERS)
    found = {s.head: s.sentences for s in verdict.write_verdict(known, summary.summarise(known))}
    return " ".join(found[head])


def test_cases_on_which_a_method_is_held_against_itself_are_named():
    rows = [
        row(case, "event_driven", 1e-12, "tol", state_sup=1e-15, state_floor=1e-13)
        for case in ("a", "b", "c")
    ]
    how = "event_driven at 1e-13 against event_driven[method=rk45] at 1e-12"
    cases = {
        "a": {"reference": "stored", "certificate": {"how": how}},
        "b": {"reference": "stored", "certificate": {"how": f"pbd; {how}"}},
        "c": {"reference": "certified", "certificate": {"how": how}},
    }
    said = told("Which orders", rows, cases)
    assert "is kept on 3 of 3 cases; the reference is two runs of this method, by different" in said
    assert said.endswith("integrators, on a.")


def test_the_cheapest_beyond_the_fourth_are_counted_and_those_by_their_orders_are_named():
    rows = []
    for k, solver in enumerate(("pbd", "catching_up", "penalty", "theta", "kdtree")):
        rows += [
            row(f"c{k}", solver, float(h), "k" if solver == "penalty" else "h")
            | {"state_sup": 0.1 * float(h), "seconds": 1e-3, "loop": "compiled"}
            for h in STEPS
        ]
    said = told("Which method", rows)
    assert "units of the case): cheapest is pbd on 1" in said and ", others on 1 of 5 cases" in said
    slow = [
        row("c", "catching_up", float(h), state_sup=1e-9, seconds=100.0, loop="compiled")
        for h in STEPS
    ]
    quick = [
        row("c", "pbd", float(h), state_sup=float(h), seconds=1e-6 / float(h), loop="compiled")
        for h in STEPS
    ]
    both = [r | {"case": case} for r in slow + quick for case in "cd"]
    assert "others would be, by their orders, on c and d." in told("Which method", both)
    assert "pbd would take less time by its order, but needs h = " in told(
        "Which method", slow + quick
    )


def test_steps_for_a_violation_are_told_with_the_cases_that_they_hold_for():
    rows = [
        row(case, "pbd", float(h), state_sup=float(h), feasibility=float(factor * h))
        for case, factor in (("a", 0.1), ("b", 1e3))
        for h in STEPS
    ]
    said = told("Which step", rows)
    assert "(a; 1 of 2 cases); not reached by pbd on b." in said


def test_methods_that_are_as_claimed_on_some_cases_only_are_told():
    rows = [
        row(case, "pbd", float(h), state_sup=float(h**p))
        for case, p in (("a", 1.0), ("b", 2.0), ("c", 1.0))
        for h in STEPS
    ]
    said = told("Which orders", rows)
    assert "As claimed on some cases, the others below or above: pbd 1 on 2 of 3 cases." in said
