"""Hybrid systems with closed forms: a ball, a neuron, a thermostat, and a clock of two rates."""

import numpy as np

from nsbench import Case, Hybrid, Transition
from nsbench.trajectory import Event

GRAVITY = 10.0


def constant(*values):
    return lambda xp: lambda t, x: xp.array([v + 0.0 * x[0] for v in values])


def level(i, value, sign=1.0):
    """Guard sign (x_i - value)."""
    return lambda xp: lambda t, x: sign * (x[i] - value)


def ball(restitution=0.5, T=1.25, samples=24, length=1.0, time=1.0):
    """A ball dropped from the height 1, in units of length and time: four impacts by T = 1.25."""
    gravity = GRAVITY * length / time**2

    def fall(xp):
        return lambda t, x: xp.array([x[1], -gravity + 0.0 * x[0]])

    def bounce(xp):
        return lambda t, x: xp.array([0.0 * x[0], -restitution * x[1]])

    fall_time = np.sqrt(2.0 / GRAVITY)
    times = [fall_time]
    speeds = [restitution * GRAVITY * fall_time]
    while times[-1] < T and len(times) < 1000:
        times.append(times[-1] + 2.0 * speeds[-1] / GRAVITY)
        speeds.append(restitution * speeds[-1])

    def exact(t):
        t = np.asarray(t) / time
        out = np.column_stack([1.0 - 0.5 * GRAVITY * t**2, -GRAVITY * t])
        for begin, v in zip(times, speeds, strict=True):
            s = t - begin
            flight = np.column_stack([v * s - 0.5 * GRAVITY * s**2, v - GRAVITY * s])
            out = np.where((s >= 0.0)[:, None], flight, out)
        return out * np.array([length, length / time])

    return Case(
        "ball",
        Hybrid({"flight": fall}, (Transition("flight", level(0, 0.0, -1.0), "flight", bounce),)),
        np.array([length, 0.0]),
        time * np.linspace(0.0, T, samples),
        exact=exact,
        exact_events=[Event(time * u, "transition", (0, 0)) for u in times if u < T],
    )


def neuron(drive=1.5, T=5.0):
    """Integrate-and-fire neuron v' = drive - v, reset from 1 to 0, with its count of spikes."""
    period = np.log(drive / (drive - 1.0))

    def charge(xp):
        return lambda t, x: xp.array([drive - x[0], 0.0 * x[0]])

    def spike(xp):
        return lambda t, x: xp.array([0.0 * x[0], x[1] + 1.0])

    def exact(t):
        spikes = np.floor(np.asarray(t) / period)
        return np.column_stack([drive * (1.0 - np.exp(spikes * period - t)), spikes])

    return Case(
        "neuron",
        Hybrid({"charge": charge}, (Transition("charge", level(0, 1.0), "charge", spike),)),
        np.zeros(2),
        np.linspace(0.0, T, 41),
        exact=exact,
        exact_events=[
            Event(k * period, "transition", (0, 0)) for k in range(1, int(T / period) + 1)
        ],
    )


LOW = 0.4
HIGH = 0.6
HEATING = np.log((1.0 - LOW) / (1.0 - HIGH))  # time from LOW to HIGH under x' = 1 - x
COOLING = np.log(HIGH / LOW)  # time from HIGH to LOW under x' = -x


def thermostat(T=3.0, samples=34):
    """Thermostat with hysteresis: x' = 1 - x while on, up to HIGH, x' = -x while off, to LOW."""
    heat = lambda xp: lambda t, x: 1.0 - x
    cool = lambda xp: lambda t, x: -x
    period = HEATING + COOLING

    def exact(t):
        s = np.mod(np.asarray(t), period)
        on = 1.0 - (1.0 - LOW) * np.exp(-s)
        return np.where(s < HEATING, on, HIGH * np.exp(HEATING - s))[:, None]

    def exact_impulse(t):
        whole, s = np.divmod(np.asarray(t), period)
        on = whole * HEATING + np.minimum(s, HEATING)
        return np.column_stack([on, t - on])

    switched = np.arange(int(T / period) + 1)[:, None] * period + [HEATING, period]
    return Case(
        "thermostat",
        Hybrid(
            {"on": heat, "off": cool},
            (
                Transition("on", level(0, HIGH), "off"),
                Transition("off", level(0, LOW), "on", direction=-1),
            ),
        ),
        np.array([LOW]),
        np.linspace(0.0, T, samples),
        exact=exact,
        exact_impulse=exact_impulse,
        exact_events=[
            Event(float(u), "transition", (0, k))
            for row in switched
            for k, u in enumerate(row)
            if u < T
        ],
    )


def clock():
    """A clock x' = r whose rate r, a state, is halved each time that it has gone 1: exact events at
    1, 3, 7 if r = 1, 1/2, 1/4."""
    run = lambda xp: lambda t, x: xp.array([x[1], 0.0 * x[1]])
    slow = lambda xp: lambda t, x: xp.array([0.0 * x[0], 0.5 * x[1]])
    starts = np.array([0.0, 1.0, 3.0])

    def exact(t):
        k = np.searchsorted(starts, t, side="right") - 1
        rate = 0.5**k
        return np.column_stack([rate * (t - starts[k]), rate])

    return Case(
        "clock",
        Hybrid({"run": run}, (Transition("run", level(0, 1.0), "run", slow),)),
        np.array([0.0, 1.0]),
        np.linspace(0.0, 6.0, 25),  # with samples at the events, t = 1 and t = 3
        exact=exact,
        exact_events=[Event(u, "transition", (0, 0)) for u in (1.0, 3.0)],
    )
