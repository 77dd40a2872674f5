"""Seconds are compared where the rule allows it; profiles, exponents and winners are those of the
rows."""

import re

import numpy as np
import pytest
from report_rows import STEPS, row

from nsbench.report import (
    assemble,
    cost,
    overview,
    performance_profiles,
    scaling,
    style,
    summary,
)
from nsbench.report import (
    data as source,
)
from nsbench.report.answers import best_method, choices
from nsbench.report.tables import clock_table, equal_error_tables

SIZES = {"discs[n=3]": 6, "discs[n=10]": 20, "discs[n=30]": 60, "discs[n=100]": 200}


def rows(case, solver, price, loop="compiled", session="one", rounds=5, reach=1.0, **more):
    """A first-order method: error reach x h at price / h seconds."""
    return [
        row(
            case,
            solver,
            float(h),
            state_sup=reach * float(h),
            seconds=price / h,
            seconds_low=0.9 * price / h,
            seconds_high=1.2 * price / h,
            rounds=rounds,
            session=session,
            steps=round(1 / h),
            drift_calls=round(1 / h),
            projections=round(3 / h),
            **{"loop": loop, **more},
        )
        for h in STEPS
    ]


def data_of(found, sizes=None):
    return source.build(
        source.columns_of(found), cases={k: {"n": n} for k, n in (sizes or {}).items()}
    )


def costs(**other):
    data = data_of(rows("a", "pbd", 1e-6) + rows("a", "catching_up", 3e-6, **other))
    return {c.solver: c for c in cost.rank_costs(data, "a", 1e-2)}


@pytest.mark.parametrize(
    "other, said",
    [
        ({}, ""),
        ({"loop": "host"}, "not compiled"),
        ({"session": "two"}, "in one go"),
        ({"rounds": 1}, "in rounds"),
        ({"shared": True}, "machine of its own"),
    ],
)
def test_seconds_are_compared_by_the_stated_rule(other, said):
    c = costs(**other)
    why = cost.why_not_comparable(c["catching_up"], c["pbd"])
    assert (said in why) if said else why == ""
    ratio = cost.ratio_of_seconds(c["catching_up"], c["pbd"])
    assert ratio is None if said else ratio == pytest.approx(3.0)
    assert cost.ratio_of_work(c["catching_up"], c["pbd"]) == pytest.approx(1.0)


def test_a_long_run_is_compared_though_it_was_timed_once_and_quartiles_are_carried():
    data = data_of(rows("a", "pbd", 1.0, rounds=1) + rows("a", "catching_up", 2.0, rounds=1))
    one, other = cost.rank_costs(data, "a", 1e-2)
    assert cost.ratio_of_seconds(other, one) == pytest.approx(2.0)
    assert one.low == pytest.approx(0.9 * one.seconds) and one.high == pytest.approx(
        1.2 * one.seconds
    )


def test_seconds_of_shared_workers_are_told_of_and_used_nowhere():
    found = rows("a", "pbd", 1e-6) + rows("a", "catching_up", 1e-9, shared=True)
    data = data_of(found)
    assert [c.solver for c in cost.rank_costs(data, "a", 1e-2)] == [
        "pbd",
        "catching_up",
    ]  # however quick it seems
    assert "catching_up" not in performance_profiles.time_ratios(data, 1e-2)
    table = clock_table.clock_table(data)
    assert [r.solver for r in table.rows] == [
        "pbd"
    ] and f" {len(STEPS)} runs were made by shared workers" in table.note
    mixed = data_of([{**r, "shared": i % 2 == 0} for i, r in enumerate(rows("a", "pbd", 1e-6))])
    assert (
        not cost.rank_costs(mixed, "a", 1e-2)[0].seconds > 0
    )  # one of the two beside it was shared


def test_a_profile_is_the_share_of_cases_within_a_factor_of_the_best():
    found = []
    for case, times in (("a", 2.0), ("b", 8.0), ("c", 0.5)):
        found += (
            rows(case, "pbd", 1e-6)
            + rows(case, "catching_up", 1e-6 * times)
            + rows(case, "euler", 1e-9, loop="host")
        )
    found += rows("d", "pbd", 1e-6, reach=1e3) + rows("d", "catching_up", 1e-6)
    got = performance_profiles.time_ratios(data_of(found), 1e-2)
    assert set(got) == {"pbd", "catching_up"}  # a loop that is not compiled is no rival
    np.testing.assert_allclose(np.sort(got["pbd"]), [1.0, 1.0, 2.0, np.inf])
    np.testing.assert_allclose(np.sort(got["catching_up"]), [1.0, 1.0, 2.0, 8.0])
    told = performance_profiles.describe_profiles(data_of(found))[0]
    assert (
        "catching_up on 2" in told
        and "pbd on 2 of 4 cases" in told
        and "ten is catching_up (4)" in told
    )


def test_the_staircase_of_a_profile_ends_at_its_share():
    found = rows("a", "pbd", 1e-6) + rows("a", "catching_up", 3e-6) + rows("b", "catching_up", 1e-6)
    data = data_of(found)
    drawn = performance_profiles.draw_profile(data, 1e-2, style.assign_looks(data.specs))
    ends = {
        int(k): [float(v) for v in d.split("L")[-1].split()]
        for k, d in re.findall(r'<g id="s(\d+)"><path d="M([^"]*)"', drawn)
    }
    heights = {k: (165.0 - y) / 144.0 for k, (_, y) in ends.items()}
    assert heights == pytest.approx(
        {
            style.assign_looks(data.specs)["pbd"].index: 0.5,
            style.assign_looks(data.specs)["catching_up"].index: 1.0,
        },
        abs=1e-2,
    )


def test_exponents_of_the_cost_are_found_with_their_interval():
    rng = np.random.default_rng(1)
    x = np.array([6.0, 20.0, 60.0, 200.0, 600.0])
    inside = 0
    for _ in range(300):
        p = scaling.fit_power(x, 1e-6 * x**1.4 * np.exp(0.1 * rng.standard_normal(5)))
        inside += p.interval[0] <= 1.4 <= p.interval[1]
    assert 270 <= inside <= 297  # 95 % of 300, within three deviations
    exact = scaling.fit_power([3, 30], [1.0, 100.0])
    assert (
        exact.exponent == pytest.approx(2.0)
        and np.isnan(exact.interval[0])
        and "[" not in str(exact)
    )
    assert scaling.fit_power([3], [1.0]) is None


def test_families_of_sizes_get_a_table_of_winners_and_exponents():
    found = []
    for case, n in SIZES.items():
        found += rows(case, "pbd", 1e-8 * n, reach=0.01 * n) + rows(
            case, "catching_up", 1e-8 * n, reach=0.3
        )
    data = data_of(found + rows("tide", "pbd", 1.0), SIZES | {"tide": 1})
    assert scaling.group_by_size(data) == {"discs": list(SIZES)}
    step, error = scaling.fit_powers(data, list(SIZES), "pbd")
    assert step.exponent == pytest.approx(1.0, abs=1e-2) and error.exponent == pytest.approx(
        2.0, abs=0.05
    )
    table = scaling.sizes_table(data)
    assert [r.cells[2].text for r in table.rows] == ["pbd", "pbd", "catching_up", "catching_up"]
    assert f"next {style.TIMES} 6.7 (pbd)" in table.rows[-1].cells[2].small and all(
        c.text for r in table.rows for c in r.cells
    )
    assert (
        "cheapest compiled method on 3 of 5 cases; another one is cheaper on 2"
        in scaling.describe_wins(data)[1]
    )
    drawn = assemble.draw_figures(data)
    assert len(drawn.scaling) == 2 and "scaling" in drawn.files and "profiles" in drawn.files


def test_every_case_has_the_three_diagrams_of_work_and_precision():
    data = data_of(rows("a", "pbd", 1e-6) + rows("a", "catching_up", 1e-6))
    drawn = assemble.draw_figures(data)
    assert all(
        any(word in svg for svg in drawn.panels["a"])
        for word in (
            "State error against seconds",
            "Against right-hand sides",
            "Against projections or inner iterations",
        )
    )
    assert drawn.files["cost_a"].count("<svg ") == 4 and "m:0" in drawn.files["cost_a"]


def test_the_clock_tells_compilation_set_up_and_run_apart():
    found = rows("a", "pbd", 1e-6) + rows("b", "pbd", 1e-6)
    for k, r in enumerate(found):
        r.update(
            compile_seconds=1.5 if k in (0, len(STEPS)) else 0.0,
            setup_seconds=2e-3,
            seconds_max=1.4 * r["seconds"],
        )
    found[3]["seconds_max"] = 9.0 * found[3]["seconds"]
    found += rows("b", "catching_up", 1e-3, rounds=1)
    first, second = clock_table.clock_table(data_of(found)).rows
    assert [c.text for c in first.cells][:3] == ["pbd", "3 s", "2 ms"]
    assert [c.text for c in first.cells][4:] == [
        f"{2 * len(STEPS)} of {2 * len(STEPS)}",
        "0.90 to 1.20",
        f"{style.TIMES} 9",
    ]
    assert [c.text for c in second.cells][1:3] == ["not told"] * 2 and second.cells[
        -1
    ].text == "no rounds"


@pytest.mark.parametrize("loop", ["host", "compiled", ""])
def test_the_best_are_counted_by_one_rule_everywhere(loop):
    """A loop of another kind is the best where it alone reaches the error."""
    data = data_of(rows("a", "pbd", 1e-6) + rows("b", "euler", 1e-6, loop=loop))
    found = summary.summarise(data)
    bests = [best_method.best_of_page(data, found, case, 1e-2) for case in "ab"]
    assert best_method.count_best(bests) == {"pbd": 1, "euler": 1}
    first = choices.write_headline(data, found)
    assert "cheapest is pbd on 1, euler on 1 of 2 cases" in first
    lines = equal_error_tables.ranking_table(data, found).rows
    counted = {line.solver: line.cells[1].small for line in lines}
    assert counted == {"pbd": "cheapest on 1", "euler": "cheapest on 1"}
    assert [line.best for line in overview.overview(data)] == ["pbd", "euler"]


def test_a_method_better_than_the_error_in_every_run_is_compared_by_a_bound():
    made = [row("a", "pbd", float(h), state_sup=float(h), seconds=1e-3 / h) for h in STEPS]
    known = {"accuracy": "tol", "loop": "compiled", "state_sup": 1e-12, "seconds": 0.05}
    made.append(row("a", "event_driven", 1e-12, **known))
    data = source.read(made)
    found = cost.cost_at_error(data.runs["a", "pbd"], 1e-2)
    told = [s for s in cost.compare_speeds(data) if s.startswith("event_driven")]
    factor = style.format_factor(0.05 / found.seconds)
    assert len(told) == 1 and f"{factor} at 1e-2 (1 case)" in told[0]
    assert "takes at most so many times the seconds of pbd" in told[0]
