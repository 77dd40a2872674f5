"""Ladders are carried on to an error that is asked for, within a budget, and no further."""

import numpy as np
import pytest

from nsbench.execute.extended_ladders import describe_unreached, further_runs
from nsbench.study.plan import plan_runs

STEPS = [0.05 / n for n in (1, 2, 3, 4, 6, 8, 11, 16)]


def study(method="pbd", order=1.0, constant=1.0, seconds=1e-6, **values):
    """Runs of one ladder with rows as they would be for a method of this order."""
    specs = plan_runs([("tide", "")], [method], values or {"h": STEPS})
    rows = []
    for s in specs:
        h = 1.0 / s.asked if s.accuracy == "k" else s.asked
        rows.append(
            {
                "case": s.case,
                "solver": s.solver,
                "accuracy": s.accuracy,
                "asked": s.asked,
                "h": h,
                "status": "ok",
                "state_sup": constant * h**order,
                "seconds": seconds / h,
                "loop": "compiled",
                "reference": "exact",
            }
        )
    return specs, rows


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_the_last_added_step_reaches_the_error(order):
    specs, rows = study(order=order)
    target = 0.02 * rows[-1]["state_sup"]
    added = further_runs(specs, rows, target, budget=60.0)
    steps = [s.asked for s in added]
    assert steps == sorted(steps, reverse=True) and max(steps) < min(STEPS)
    assert 0.3 * target < steps[-1] ** order < target
    assert {(s.case, s.solver) for s in added} == {("tide", "pbd")}


def test_steps_end_at_the_sample_times():
    added = further_runs(*study(), 1e-5, budget=60.0)
    assert all(abs(0.05 / s.asked - round(0.05 / s.asked)) < 1e-9 for s in added)


def test_a_stiffness_is_raised():
    specs, rows = study("penalty", k=[10.0, 20.0, 40.0, 80.0, 160.0, 320.0])
    added = further_runs(specs, rows, 1e-4, budget=60.0)
    assert added[-1].asked > 1e4 and all(s.accuracy == "k" for s in added)


def test_what_is_reached_costs_too_much_or_has_no_order_is_left():
    specs, rows = study()
    assert not further_runs(specs, rows, 2.0 * rows[-1]["state_sup"], budget=60.0)
    assert not further_runs(specs, rows, 1e-6, budget=1e-3)
    assert not further_runs(specs, rows, 1e-15, budget=1e9)  # below rounding
    noise = np.random.default_rng(0).uniform(0.1, 10.0, len(rows))
    for r, factor in zip(rows, noise, strict=True):
        r["state_sup"] = 1e-2 * factor
    assert not further_runs(specs, rows, 1e-4, budget=60.0)


def test_why_an_error_is_not_reached_is_said():
    _, rows = study()
    assert describe_unreached(rows, 2.0 * rows[-1]["state_sup"], 60.0) == []
    (line,) = describe_unreached(rows, 1e-6, 2.5)
    assert line == (
        "error 1e-06 not reached by pbd on tide: in 3 rounds and 2.5 s of a method on a case "
        "(--budget)"
    )
    for k, r in enumerate(rows):
        r["state_sup"] = 1e-2 * (1 + k % 2)
    (line,) = describe_unreached(rows, 1e-6, 2.5)
    assert line.endswith("by pbd on tide: their orders are not clear enough to tell a step")
