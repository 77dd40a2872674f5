"""Orders are fitted against the step that was taken, never against the one asked for."""

import numpy as np
import pytest

import nsbench
from nsbench.report import data, summary

STEPS = (
    0.05 / 6.3 * 2.0 ** -np.arange(0.0, 6.4, 0.27)
)  # none of them divides the spacing of the samples


def fits():
    study = nsbench.run("tide", "pbd", h=STEPS)
    return study, summary.summarise(data.read(study))["tide", "pbd"].state


@pytest.mark.long
@pytest.mark.survives("end between steps")
def test_a_row_holds_the_step_that_divides_the_spacing():
    study, _ = fits()
    spacing = float(np.diff(nsbench.get_case("tide").t).min())
    for r in study.rows:
        assert r["asked"] > r["h"] and abs(spacing / r["h"] - np.ceil(spacing / r["asked"])) < 1e-9


@pytest.mark.long
@pytest.mark.survives("end between steps")
def test_the_order_in_the_steps_taken_is_sharper_than_in_those_asked():
    study, taken = fits()
    assert taken.verdict == "order" and abs(taken.order - 1.0) < 0.01
    asked = nsbench.fit_order(
        [r["asked"] for r in study.rows], [r["state_sup"] for r in study.rows]
    )
    width = lambda interval: interval[1] - interval[0]
    assert width(asked.interval) > 3 * width(taken.interval)
