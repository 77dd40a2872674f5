"""Steps that reach an error beyond the ladder keep it when they are run."""

import numpy as np
import pytest
from report_rows import STEPS, row, summaries

from nsbench.report import cost as speed
from nsbench.report import data, summary


def test_an_error_beyond_the_ladder_has_an_extrapolated_step():
    """Order one with seconds 1/h: a hundredth of the finest error needs a hundredth of its step."""
    rows = [
        row("a", "pbd", float(h), state_sup=3.0 * h, seconds=1e-6 / h, loop="compiled")
        for h in STEPS
    ]
    read = data.read(rows)
    found = summary.summarise(read)["a", "pbd"]
    finest = min(STEPS)
    cost = speed.extrapolate_cost(found, 0.03 * finest)
    assert cost.is_extrapolated and cost.h == pytest.approx(0.01 * finest, rel=0.02)
    assert cost.seconds == pytest.approx(1e-6 / cost.h, rel=0.02)
    assert speed.extrapolate_cost(found, 3.1 * finest) is None  # a run reaches it
    quick = [r | {"seconds": r["h"]} for r in rows]  # noise: the finest run took the least
    noisy = speed.extrapolate_cost(summary.summarise(data.read(quick))["a", "pbd"], 0.03 * finest)
    finer = sorted(STEPS)[: (len(STEPS) + 1) // 2]
    assert noisy.seconds == pytest.approx(np.median(finer))
    assert speed.extrapolate_cost(found, 1e-14) is None  # rounding does not allow it
    rows[-1]["state_sup"] = 50.0 * rows[-1]["state_sup"]
    wild = summary.summarise(data.read(rows))["a", "pbd"]
    assert speed.extrapolate_cost(wild, 0.03 * finest) is None or wild.state.verdict == "order"


def test_the_part_of_a_run_that_has_no_steps_is_not_carried_on():
    """1 ms and 1 us a step, seen where the first is the larger: a power law of these runs has the
    exponent 0.3, and three decades on a ninth of the seconds."""
    rows = [row("a", "pbd", float(h), state_sup=float(h), seconds=1e-3 + 1e-6 / h) for h in STEPS]
    cost = speed.extrapolate_cost(summaries(rows)["a", "pbd"], 1e-3 * min(STEPS))
    assert cost.seconds == pytest.approx(1e-3 + 1e-6 / cost.h, rel=1e-3)


def test_one_slow_timing_turns_no_extrapolation():
    rows = [row("a", "pbd", float(h), state_sup=float(h), seconds=1e-3 + 1e-6 / h) for h in STEPS]
    for slow in (-1, -2, -4):
        spoilt = [dict(r) for r in rows]
        spoilt[slow]["seconds"] *= 15.0
        cost = speed.extrapolate_cost(summaries(spoilt)["a", "pbd"], 1e-3 * min(STEPS))
        assert cost.seconds == pytest.approx(1e-3 + 1e-6 / cost.h, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_an_extrapolated_step_keeps_the_error_though_the_ladder_scatters(seed):
    """A step by the fitted order, from the finest error alone, misses it in every second case."""
    factor = np.random.default_rng(seed).uniform(0.9, 1.1, len(STEPS))
    rows = [
        row("a", "pbd", float(h), state_sup=float(3.0 * f * h), seconds=1e-6 / h)
        for h, f in zip(STEPS, factor, strict=True)
    ]
    found = summaries(rows)["a", "pbd"]
    for part in (0.3, 0.1, 0.01):
        target = 3.0 * part * min(STEPS)
        cost = speed.extrapolate_cost(found, target)
        assert cost.is_extrapolated and 0.5 * target < 3.0 * cost.h <= target


def test_errors_that_no_step_lowers_are_not_extrapolated():
    rows = [row("a", "pbd", float(h), state_sup=0.3, seconds=1e-6 / h) for h in STEPS]
    found = summary.summarise(data.read(rows))["a", "pbd"]
    assert speed.extrapolate_cost(found, 0.01) is None
