"""Trajectories of piecewise smooth systems at 45 digits: extrapolated midpoint rule, roots of
guards, a march of modes.

Nothing here is taken from the package: the truths of tests/independent are a second derivation.
Times are `mpf`, states lists of `mpf`. A step is Gragg's midpoint rule, extrapolated (Hairer,
Norsett, Wanner, Solving ODEs I, II.9).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from mpmath import mp, mpf, nstr

mp.dps = 45
TOL = mpf(10) ** -34  # of one step: leaves eleven digits to rounding
COLUMNS = 12  # of the extrapolation table: order 24
EPS = mpf(10) ** -30  # a guard may stand at its root: it counts as fallen below -EPS
ZERO = mpf(10) ** -27  # a gap or a rate as small as this is zero: EPS with room for a short step
SYSTEMS: dict[str, System] = {}


@dataclass(frozen=True)
class Path:
    """One trajectory: times, states, cumulative impulses (one column per id), events (time, kind,
    id), modes (time, mode)."""

    t: list
    x: list
    impulse: list
    events: list
    ids: list
    modes: list = field(default_factory=list)
    reaction: list | None = None


@dataclass(frozen=True)
class System:
    """How a truth is computed and what of it is unique.

    events: "all", "times" (which contact acts is not unique, when the contacts act is) or "none".
    weights: only these combinations of the impulses are unique (None: each is; empty: none is).
    optional: times at which an event may or may not be told, as at the start.
    """

    path: object
    events: str = "all"
    weights: tuple | None = None
    optional: tuple = ()


def system(**flags):
    """Enters the function below, which returns a Path, under its own name."""

    def enter(path):
        SYSTEMS[path.__name__] = System(path, **flags)
        return path

    return enter


def columns(n):
    """The ids of n contacts of one family."""
    return [(0, k) for k in range(n)]


def linspace(a, b, k):
    """The doubles of numpy.linspace, exactly."""
    return [mpf(float(v)) for v in np.linspace(a, b, k)]


def extrapolated(flow, t, y, H):
    """(y(t + H), estimated error) of y' = flow(t, y) by the extrapolated midpoint rule."""
    slope = flow(t, y)
    table = []
    for k in range(COLUMNS):
        N = 2 * (k + 1)
        h = H / N
        a = y
        b = [v + h * d for v, d in zip(y, slope, strict=True)]
        for s in range(1, N):
            a, b = b, [v + 2 * h * d for v, d in zip(a, flow(t + s * h, b), strict=True)]
        row = [[(u + v + h * d) / 2 for u, v, d in zip(a, b, flow(t + H, b), strict=True)]]
        for j in range(1, k + 1):
            ratio = (mpf(k + 1) / (k + 1 - j)) ** 2 - 1
            row.append(
                [u + (u - v) / ratio for u, v in zip(row[j - 1], table[k - 1][j - 1], strict=True)]
            )
        table.append(row)
        if k >= 3:  # two entries that agree by chance are not four
            err = max(abs(u - v) / (1 + abs(u)) for u, v in zip(row[-1], row[-2], strict=True))
            if err < TOL:
                break
    return table[-1][-1], err


def advance(flow, t, y, H):
    """y(t + H), halving the step until the estimate is met."""
    end, err = extrapolated(flow, t, y, H)
    if err < TOL * 100:  # not met in all columns, but the next halving would gain nothing
        return end
    if abs(H) < mpf(10) ** -9:
        raise RuntimeError(f"step too small at t = {nstr(t, 15)}: error {nstr(err, 5)}")
    return advance(flow, t + H / 2, advance(flow, t, y, H / 2), H / 2)


def root(phi, a, b, fa, fb):
    """The root of phi between a and b, of which the values fa and fb have different signs
    (Illinois)."""
    for _ in range(200):
        c = b - fb * (b - a) / (fb - fa)
        if not min(a, b) <= c <= max(a, b):
            c = (a + b) / 2
        fc = phi(c)
        if fc == 0 or abs(b - a) < mpf(10) ** -33 * (1 + abs(c)) or abs(fc) < mpf(10) ** -40:
            return c
        a, fa = (b, fb) if fc * fb < 0 else (a, fa / 2)
        if abs(c - b) < mpf(10) ** -36:
            return c
        b = c
        fb = fc
    return c


def fall(flow, guard, t, y, end, last):
    """Time in (t, end] at which `guard` falls below -EPS; it may stand at its root at t, and is
    `last` + EPS at the end."""
    first = guard(t, y) + EPS
    if first <= 2 * EPS:
        d = (end - t) / 2
        for _ in range(90):  # 2^-90 of a step is below EPS
            later = advance(flow, t, y, d)
            first = guard(t + d, later) + EPS
            if first > 2 * EPS:
                break
            d /= 2
        else:
            raise RuntimeError(f"a guard falls at once after t = {nstr(t, 20)}")
        t = t + d
        y = later
    return root(lambda s: guard(s, advance(flow, t, y, s - t)) + EPS, t, end, first, last)


def next_event(flow, guards, t, y, end):
    """(time, state, tags) at `end`, or where a guard falls first, with the tags of all that fall
    there."""
    after = advance(flow, t, y, end - t)
    hits = []
    for tag, guard in guards:
        last = guard(end, after) + EPS
        if last < 0:
            hits.append((fall(flow, guard, t, y, end, last), tag))
    if not hits:
        return end, after, []
    first = min(s for s, _ in hits)
    return first, advance(flow, t, y, first - t), [tag for s, tag in hits if s < first + ZERO]


def march(modes, x0, ts, H, breaks=(), mode=None):
    """The Path of the system `modes` from x0 through the times ts, by steps of H (a number or a
    function of t).

    `modes.ids` names the impulses. `modes.parts(mode, era, t, x)` gives the right-hand side, the
    multipliers and the guards [(tag, function of (t, x))] that stay >= 0 while the mode lasts,
    `modes.decide(t, x, mode, tags, era)` the next mode and its events [(kind, id)]; mode None asks
    for the first. The era grows by one at each of `breaks`.
    """
    n = len(x0)
    ts = [mpf(t) for t in ts]
    t = ts[0]
    y = [mpf(v) for v in x0] + [mpf(0)] * len(modes.ids)
    mode = modes.decide(t, y[:n], None, [], 0)[0] if mode is None else mode
    out = [y]
    events = []
    history = [(t, mode)]
    era = 0
    breaks = [*map(mpf, breaks), ts[-1] + 1]
    while t < ts[-1]:
        rhs, lam, guards = modes.parts(mode, era, t, y[:n])
        flow = lambda s, z, rhs=rhs, lam=lam: [*rhs(s, z[:n]), *lam(s, z[:n])]
        guards = [(tag, lambda s, z, g=g: g(s, z[:n])) for tag, g in guards]
        tags = []
        while t < ts[-1] and not tags:
            end = min(t + mpf(H(t) if callable(H) else H), ts[-1], breaks[era])
            end, after, tags = next_event(flow, guards, t, y, end)
            while len(out) < len(ts) and ts[len(out)] <= end:
                s = ts[len(out)]
                out.append(advance(flow, t, y, s - t) if s < end else after)
            t = end
            y = after
            if not tags and t >= breaks[era]:
                tags = ["break"]
                era = era + 1
        if tags:
            mode, told = modes.decide(t, y[:n], mode, tags, era)
            events += [(t, kind, c) for kind, c in told]
            history.append((t, mode))
    return Path(ts, [y[:n] for y in out], [y[n:] for y in out], events, modes.ids, history)


def closed(pieces, ts, ids, events):
    """The Path of closed forms: pieces (end or None, state(t), impulse(t)) in order of their
    ends."""
    at = [next(p for p in pieces if p[0] is None or t <= p[0]) for t in ts]
    rows = lambda k: [[mpf(v) for v in p[k](t)] for p, t in zip(at, ts, strict=True)]
    return Path(ts, rows(1), rows(2), events, ids)
