"""No passage through a surface is missed because it is narrow: in space, in time, or of a sliding
weight."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import erf

from nsbench import Case, Filippov, solve

RNG = np.random.default_rng(7)
DIPS = [
    (10.0 ** RNG.uniform(-3, -2), RNG.uniform(0.3, 1.7)) for _ in range(20)
]  # width of contact, place


def constant(*v):
    return lambda xp: lambda t, x: xp.array(v) + 0.0 * x


def bell(xp, u, w):
    """1 far off, -1 at 0, zero at +-w/2: nothing beside the dip tells of it."""
    return 1.0 - 2.0 * xp.exp(-np.log(2.0) * (2.0 * u / w) ** 2)


def pole(xp, u, w):
    """A rational dip, with long slopes."""
    return (u * u - 0.25 * w * w) / (u * u + 0.05 * w)


@pytest.mark.parametrize("shape", [bell, pole])
@pytest.mark.parametrize("along", ["x", "t"])
def test_twenty_of_twenty_narrow_dips_are_crossed(along, shape):
    # the drift is constant and the run one sample long: no step has another reason to be short
    for w, place in DIPS:

        def switch(xp, w=w, place=place):
            return lambda t, x: shape(xp, (x[0:1] if along == "x" else t + 0.0 * x[0:1]) - place, w)

        case = Case(
            "dip",
            Filippov({(1,): constant(1.0, -1.0), (-1,): constant(1.0, 3.0)}, switch),
            np.zeros(2),
            np.array([0.0, 2.0]),
        )
        traj = solve(case, "event_driven")
        assert [e.kind for e in traj.events] == ["cross", "cross"], (w, place)
        np.testing.assert_allclose(
            [e.t for e in traj.events], [place - w / 2, place + w / 2], rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(traj.x[-1], [2.0, 4.0 * w - 2.0], rtol=0, atol=1e-12)
        assert abs(traj.impulse[-1, 0] - (2.0 - w)) < 1e-12 and traj.stats["roots"] == "verified"


def depth(u, k):
    """Integral of the bell from its middle on."""
    return u - np.sqrt(np.pi) / k * erf(k * u)


def test_twenty_of_twenty_short_exits_from_sliding_are_taken():
    # below, the push up turns for an instant: the point is let down by it and comes back
    for w, place in DIPS:

        def below(xp, w=w, place=place):
            return lambda t, x: xp.array([1.0, bell(xp, t - place, w)]) + 0.0 * x

        case = Case(
            "dip",
            Filippov({(1,): constant(1.0, -1.0), (-1,): below}, lambda xp: lambda t, x: x[1:2]),
            np.zeros(2),
            np.array([0.0, 2.0]),
        )
        traj = solve(case, "event_driven")
        k = 2.0 * np.sqrt(np.log(2.0)) / w
        back = brentq(lambda u, w=w, k=k: depth(u, k) + depth(w / 2, k), w / 2, 10 * w, xtol=1e-16)
        assert [e.kind for e in traj.events] == ["exit", "enter"], (w, place)
        np.testing.assert_allclose(
            [e.t for e in traj.events], [place - w / 2, place + back], rtol=0, atol=1e-11
        )


def test_a_field_that_only_numbers_can_enter_is_sampled_and_says_so():
    # float() stops every proof; steps are bounded then and the run says how roots were found
    field = lambda xp: lambda t, x, s: np.array([1.5 - 0.5 * s[0], -s[0] + 0.0 * float(x[0])])
    case = Case(
        "plain",
        Filippov.signs(field, lambda xp: lambda t, x: x[1:2]),
        np.array([0.0, 0.5]),
        np.linspace(0, 2, 5),
    )
    traj = solve(case, "event_driven")
    assert traj.status.ok and traj.stats["roots"] == "sampled"
    np.testing.assert_allclose(traj.x[-1], [2.75, 0.0], atol=1e-12)
