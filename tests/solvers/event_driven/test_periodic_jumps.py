"""floor, % and tables with a period: ramps, pulse-width modulation and square waves, compiled."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from nsbench import Case, Filippov, solve

PERIOD, LOW, HIGH = 400e-6, 3.8, 8.2  # of the ramp, in s and V
R, L, C = 22.0, 20e-3, 47e-6
GAIN, WANTED, INPUT = 8.4, 11.3, 24.0
START = np.array([11.5, 0.55])
A = np.array([[-1.0 / (R * C), 1.0 / C], [-1.0 / L, 0.0]])


def buck(periods, ramp):
    """A buck converter: the switch is open while the amplified error of the voltage is above a
    ramp (Deane & Hamill 1990)."""

    def field(xp):
        return lambda t, x, s: xp.stack(
            (
                -x[0] / (R * C) + x[1] / C,
                -x[0] / L + INPUT / L * 0.5 * (1.0 - s[0]),
            )
        )

    def switch(xp):
        up = ramp(xp)
        error = lambda x: GAIN * (x[0] - WANTED)
        return lambda t, x: xp.stack((error(x) - LOW - (HIGH - LOW) * up(t / PERIOD),))

    times = np.linspace(0.0, periods * PERIOD, 41)
    return Case("buck", Filippov(None, switch, field, 1), START, times)


RAMPS = {
    "floor": lambda xp: lambda u: u - xp.floor(u),
    "remainder": lambda xp: lambda u: u % 1.0,
    "floor division": lambda xp: lambda u: u - u // 1.0,
    "ceil": lambda xp: lambda u: 1.0 + u - xp.ceil(u),
    "rint": lambda xp: lambda u: 0.5 + (u - 0.5) - xp.rint(u - 0.5),
}


def truth(periods):
    """End state and event times: exact flows of both linear modes, roots on a grid."""
    flows = {}
    for opened in (0, 1):
        M = np.zeros((3, 3))
        M[:2, :2] = A
        M[1, 2] = 0.0 if opened else INPUT / L
        flows[opened] = M
    x, t, events = np.append(START, 1.0), 0.0, []
    error = lambda x, u: GAIN * (x[0] - WANTED) - LOW - (HIGH - LOW) * u
    opened = int(error(x, 0.0) > 0.0)
    for k in range(periods):
        at = lambda s, M, x: expm(M * s) @ x
        if k and int(error(x, 0.0) > 0.0) != opened:
            opened = 1 - opened
            events.append(k * PERIOD)
        t = k * PERIOD
        while True:
            M = flows[opened]
            gap = lambda s, M=M, x=x, t=t: error(at(s, M, x), (t + s) / PERIOD - k)
            grid = np.linspace(1e-10, (k + 1) * PERIOD - t, 60)
            values = [gap(s) for s in grid]
            turn = next((j for j in range(59) if values[j] * values[j + 1] < 0.0), None)
            if turn is None:
                x = at((k + 1) * PERIOD - t, M, x)
                break
            s = brentq(gap, grid[turn], grid[turn + 1], xtol=1e-19, rtol=1e-15)
            x, t, opened = at(s, M, x), t + s, 1 - opened
            events.append(t)
    return x[:2], np.array(events)


@pytest.fixture(scope="module")
def true():
    return truth(12)


@pytest.mark.parametrize("name", RAMPS)
def test_a_buck_converter_switches_when_it_should(name, true):
    run = solve(buck(12, RAMPS[name]), "event_driven")
    x, events = true
    assert run.status.ok and len(events) > 15
    assert [e.kind for e in run.events] == ["cross"] * len(events)
    assert np.abs([e.t for e in run.events] - events).max() < 1e-11 * 12 * PERIOD
    assert np.abs(run.x[-1] / x - 1.0).max() < 1e-10
    assert "could not be" not in run.stats.get("note", "")


def waves(field, x0=0.1, end=7.5):
    switch = lambda xp: lambda t, x: x[:1] + 0.0 * t
    times = np.linspace(0.0, end, 31)
    return Case("waves", Filippov(None, switch, field, 1), np.array([x0]), times)


def test_a_field_that_jumps_in_every_period():
    step = lambda xp: lambda t: xp.floor(2.0 * t) - 2.0 * xp.floor(t)  # 0, 1, 0, 1 by halves
    field = lambda xp: lambda t, x, s: xp.stack((0.5 + step(xp)(t) - 0.25 * s[0],))
    run = solve(waves(field), "event_driven")
    t = run.t
    whole = np.floor(t)
    expected = 0.1 + 0.25 * t + 0.5 * whole + np.maximum(t - whole - 0.5, 0.0)
    assert run.status.ok and run.stats["loop"] == "compiled"
    assert np.abs(run.x[:, 0] - expected).max() < 1e-12


def test_a_table_with_a_period_is_the_long_table():
    """A triangle wave through (0.25, 1) and (0.75, -1), whose table has no point at the ends."""

    def case(table):
        field = lambda xp: lambda t, x, s: -x - 0.5 * s
        switch = lambda xp: lambda t, x: x[:1] - 0.3 * table(xp)(t)
        times = np.linspace(0.0, 6.0, 25)
        return Case("triangle", Filippov(None, switch, field, 1), np.array([1.0]), times)

    short = lambda xp: lambda t: xp.interp(
        t, xp.array([0.25, 0.75]), xp.array([1.0, -1.0]), period=1.0
    )
    at = 0.5 * np.arange(-1, 14) + 0.25
    heights = np.where(np.arange(15) % 2, 1.0, -1.0)
    long = lambda xp: lambda t: xp.interp(t, xp.asarray(at), xp.asarray(heights))
    one, other = (solve(case(table), "event_driven") for table in (short, long))
    assert one.status.ok and one.stats["loop"] == "compiled" and len(one.events) > 5
    assert np.abs(one.x - other.x).max() < 1e-12


STEPS = {
    "floor": lambda xp: xp.floor,
    "where": lambda xp: (
        lambda t: xp.where(t < 1.0, 0.0, xp.where(t < 2.0, 1.0, xp.where(t < 3.0, 2.0, 3.0)))
    ),
}


@pytest.mark.parametrize("name", STEPS)
def test_a_surface_that_jumps_away_from_what_slides_on_it(name):
    """The surface steps up by 1 at t = 1, 2, 3; the state slides on it, then follows at speed 2."""
    field = lambda xp: lambda t, x, s: -2.0 * s
    switch = lambda xp: lambda t, x: x[:1] - STEPS[name](xp)(t)
    case = Case("steps", Filippov(None, switch, field, 1), np.zeros(1), np.linspace(0.0, 3.25, 14))
    run = solve(case, "event_driven")
    whole = np.floor(run.t)
    expected = np.where(run.t < 1.0, 0.0, np.minimum(whole, whole - 1.0 + 2.0 * (run.t - whole)))
    assert run.status.ok and run.stats["loop"] == "compiled"
    assert np.abs(run.x[:, 0] - expected).max() < 1e-12
    assert np.allclose([e.t for e in run.events], [1.0, 1.5, 2.0, 2.5, 3.0], rtol=0, atol=1e-12)


def test_a_floor_of_the_state_is_told():
    field = lambda xp: lambda t, x, s: xp.floor(x) - 0.25 * s
    run = solve(waves(field), "event_driven")
    assert "floor of what is no linear function of the time cannot" in run.stats["note"]
