"""An error that turns with the phase of the step is no plateau: the falling apple under explicit
Euler, really run."""

import numpy as np
import pytest

import nsbench

T = 1.94  # one spacing, so that T / n is the step taken, whatever n


def fallen(counts):
    """(steps taken, errors at T) of explicit Euler on the apple in its Filippov form, from height
    1."""
    case = nsbench.get_case("apple_filippov").replace(t=np.array([0.0, T]))
    out = []
    for n in counts:
        traj = nsbench.solve(case, "euler", h=T / n)
        out.append((traj.stats["h"], nsbench.errors(case, traj)["state_sup"]))
    return np.array(out).T


def test_dyadic_steps_show_a_plateau_that_is_not_there_and_get_no_verdict():
    h, err = fallen(2 * 2 ** np.arange(12))
    assert h == pytest.approx(0.97 * 2.0 ** -np.arange(12), rel=1e-12)
    assert np.ptp(err[-6:]) < 1e-9 and err[-1] > 1e-4  # the same error over five halvings
    fit = nsbench.fit_order(h, err)
    assert fit.verdict == "undecided" and "dyadic" in fit.sentence
    same = 1.94 / (2 * 2 ** np.arange(12))  # and also when the ladder is long and the fit perfect
    assert (
        nsbench.fit_order(np.append(same, same / 2**12), np.append(same, same / 2**12)).verdict
        == "undecided"
    )


def test_sixteen_steps_per_octave_show_order_one():
    h, err = fallen(np.unique(np.round(2 * 2 ** np.arange(0, 11, 1 / 16)).astype(int)))
    fit = nsbench.fit_order(h, err)
    assert fit.envelope == pytest.approx(1.0, abs=0.05)
    assert fit.envelope_interval[0] <= 1.0 <= fit.envelope_interval[1]
    assert fit.verdict == "order" and fit.interval[0] <= 1.0 <= fit.interval[1], fit.sentence
    assert "largest error" in fit.sentence and fit.order == pytest.approx(1.0, abs=0.06)


def test_exact_at_some_steps_and_wrong_at_others_is_said_in_these_words():
    case = nsbench.get_case("sliding")
    spacing = float(np.diff(case.t).min())
    out = []
    for n in (1, 2, 3, 4, 5, 6, 7, 9, 11, 13, 16, 20, 24, 29, 35, 43, 52, 63, 77):
        traj = nsbench.solve(case, "euler", h=spacing / n)
        out.append((traj.stats["h"], nsbench.errors(case, traj)["state_sup"]))
    h, err = np.array(out).T
    assert (err < 1e-12).sum() >= 4 and (err > 1e-4).sum() >= 8
    fit = nsbench.fit_order(h, err, span=float(case.t[-1]))
    assert (
        fit.verdict == "undecided"
        and f"exact to rounding at {(err < 1e-12).sum()} of 19 steps" in fit.sentence
    )


def test_errors_of_stick_and_slip_that_happen_to_lie_level_are_no_plateau():
    """Explicit Euler on x' = v, v' = 0.3 cos 1.3 t - x - 0.1 v - mu sign(v - v0) at 9 samples up
    to T, against a solution to 1e-8: at steps 64 times finer the errors are below 2e-5."""
    T = 6.218446537175942
    steps = [16, 20, 25, 32, 40, 51, 64, 81, 102, 129, 163, 206, 260, 329, 416, 526, 665, 840, 1062]
    errors = [6.22e-2, 4.51e-2, 4.06e-2, 2.18e-2, 1.75e-2, 1.71e-2, 1.25e-2, 7.88e-3, 6.66e-3]
    errors += [3.45e-3, 6.28e-3, 3.49e-3, 3.23e-3, 1.62e-3, 2.14e-3, 1.35e-3, 1.27e-3, 1.35e-3]
    fit = nsbench.fit_order(T / 8 / np.array(steps), [*errors, 9.72e-4], floor=1e-8, span=T)
    assert fit.verdict in ("undecided", "pre-asymptotic"), fit.sentence
