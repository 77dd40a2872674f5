"""What the gate holds: the width of an order's interval and every column about multipliers."""

from dataclasses import replace

import numpy as np
import pytest
from report_rows import STEPS, ladder, row

from nsbench.gate import baseline
from nsbench.gate.comparison import compare
from nsbench.gate.facts import facts
from nsbench.report.data import build, columns_of

MULTIPLIERS = (
    *("impulse", "reaction", "l1", "settled", "sup", "lam_own", "lam_at_start", "lam_at_mid"),
    *("lam_at_end", "lam_mean", "selection", "polyhedron", "sign"),
)


def facts_of(rows):
    return facts(build(columns_of(rows), cases={}, solvers={}))


def outcome(found, metric, value):
    """Outcome of another value of a metric, held against what was found."""
    (fact,) = [f for f in found.values() if f.metric == metric]
    line = baseline.line(fact, 0.0, "first")
    return compare({fact.key: replace(fact, value=value)}, {fact.key: line})[0].outcome


@pytest.mark.parametrize("name", ("state", "force"))
def test_the_interval_of_an_order_is_held(name):
    found = facts_of(ladder("tide", "pbd", np.random.default_rng(1)))
    width = found["tide", "pbd", "ladder", f"{name} half-width"].value
    assert 0.0 < width < 0.1
    assert {f.floor for k, f in found.items() if k[3].endswith("half-width")} == {1e-9}
    assert outcome(found, f"{name} half-width", width) == "pass"
    assert outcome(found, f"{name} half-width", 1.01 * width) == "regressed"


def test_an_interval_that_rounding_alone_widens_is_no_regression():
    """Errors that are h to the last digits: another processor rounds their order otherwise."""
    rows = [row("tide", "pbd", h, state_sup=h * (1.0 + 1e-13 * k)) for k, h in enumerate(STEPS)]
    found = facts_of(rows)
    width = found["tide", "pbd", "ladder", "state half-width"].value
    assert width < 1e-11
    assert outcome(found, "state half-width", width + 1e-11) == "pass"
    assert outcome(found, "state half-width", width + 1e-8) == "regressed"


@pytest.mark.parametrize("metric", MULTIPLIERS)
def test_every_column_of_multipliers_is_held(metric):
    found = facts_of([row("tide", "pbd", 0.01, **{metric: 0.25})])
    assert outcome(found, metric, 0.25) == "pass"
    assert outcome(found, metric, 0.2525) in ("regressed", "improved")


@pytest.mark.parametrize(
    "before, after, expected",
    [
        (0.0, -1e-3, "regressed"),
        (-1e-14, -1e-13, "regressed"),
        (-1e-14, -2e-14, "pass"),
        (1e-14, 1e-12, "pass"),
        (-0.25, -0.26, "regressed"),
        (-0.25, -0.24, "improved"),
    ],
)
def test_a_least_multiplier_is_held_from_below(before, after, expected):
    """Near its value where that is no rounding; neither direction passes there."""
    found = facts_of([row("tide", "pbd", 0.01, sign=before, impulse_scale=1e-2)])
    assert outcome(found, "sign", after) == expected
