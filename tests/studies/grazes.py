"""Tangential and near-tangential passages with closed forms: how many contacts does the
event-driven method miss?

    python tests/studies/grazes.py --passages 1000 --seed 0

Each passage goes by a wall, a moving wall, a disc, a leash or a narrow bump of a wall at a random
time and touches for a contact interval between 1e-3 and 0.3 (half of them), misses by a clearance
between 1e-12 and 1e-2, or touches in one point. In between are few samples, so that steps are long.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from dataclasses import dataclass

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from nsbench import Affine, Case, Complementarity, Distance  # noqa: E402
from nsbench.solvers import solve  # noqa: E402

KINDS = ("wall", "moving_wall", "disc", "leash", "bump")


@dataclass(frozen=True)
class Passage:
    """case; times: contact and release, empty if it stays clear; end: the state at T; touch: one
    point of contact."""

    case: Case
    times: tuple
    end: np.ndarray
    touch: bool


def passage(kind: str, length: float, clear: float, rng) -> Passage:
    """A passage with that contact interval, or (length 0) that clearance; clear = 0 touches in one
    point."""
    T = rng.uniform(3.0, 6.0)
    c = rng.uniform(1.3, 2.2)
    contact = length > 0.0
    x0, problem, end, start, stop = globals()["_" + kind](length, clear, c, T, rng)
    case = Case(
        name=f"graze_{kind}", problem=problem, x0=x0, t=np.linspace(0.0, T, int(rng.integers(2, 6)))
    )
    return Passage(case, (start, stop) if contact else (), end, clear == 0.0 and not contact)


def _wall(length, clear, c, T, rng):
    """x2' = 2 a (t - c) over the floor x2 = 0: the parabola a (t - c)^2 + lowest."""
    a = rng.uniform(0.3, 3.0)
    low = -a * length**2 if length else clear
    after = a * (T - c) ** 2 + (0.0 if length else low)
    drift = lambda xp: lambda t, x: xp.stack((1.0 + 0.0 * x[1], 2 * a * x[0]))
    return (
        np.array([-c, low + a * c**2]),
        Complementarity(drift, (Affine([[0.0, 1.0]], [0.0]),)),
        np.array([T - c, after]),
        c - length,
        c,
    )


def _moving_wall(length, clear, c, T, rng):
    """A point at rest that a wall A cos(w (t - c)) lifts to A."""
    A = rng.uniform(0.5, 2.0)
    w = rng.uniform(0.7, 1.4)
    y = A * np.cos(w * length) if length else A + clear
    wall = Affine([[1.0]], lambda xp: lambda t: -A * xp.cos(w * (t - c)) * xp.ones(1))
    return (
        np.array([y]),
        Complementarity(lambda xp: lambda t, x: 0.0 * x, (wall,)),
        np.array([A if length else y]),
        c - length,
        c,
    )


def _disc(length, clear, c, T, rng):
    """Past the unit disc with f = (1, 0); in contact the angle obeys a' = -cos a, so length =
    artanh(sin a)."""
    sine = np.tanh(length)
    y = np.sqrt(1.0 - sine**2) if length else 1.0 + clear
    start = c - length
    x0 = -sine - start if length else -c
    end = np.array([T - c, 1.0 if length else y])
    return (
        np.array([x0, y]),
        Complementarity(
            lambda xp: lambda t, x: xp.stack((1.0 + 0.0 * x[0], 0.0 * x[1])),
            (Distance(d=1.0, anchors=np.zeros((1, 2))),),
        ),
        end,
        start,
        c,
    )


def _leash(length, clear, c, T, rng):
    """Pulled out radially to the end of a leash of length 1, and back again: y' = -a sin(w (t -
    c))."""
    w = rng.uniform(0.5, 1.0)
    a = w * rng.uniform(0.3, 0.7)  # it does not come out on the other side
    reach = (
        1.0 + a / w * (1.0 - np.cos(w * length)) if length else 1.0 - clear
    )  # of the free motion, at t = c
    free = lambda t: reach - a / w * (1.0 - np.cos(w * (t - c)))
    u = np.array([np.cos(0.3), np.sin(0.3)])
    drift = lambda xp: lambda t, x: -a * xp.sin(w * (t - c)) * u + 0.0 * x
    end = (free(T) + (1.0 - reach if length else 0.0)) * u
    return (
        free(0.0) * u,
        Complementarity(drift, (Distance(d=1.0, sign=-1, anchors=np.zeros((1, 2))),)),
        end,
        c - length,
        c,
    )


def _bump(length, clear, c, T, rng):
    """A wall at rest with a bump exp(-((t - c) / s)^2) in time, s from 1e-3 on."""
    s = length / rng.uniform(0.3, 1.5) if length else 10.0 ** rng.uniform(-3, -0.5)
    y = np.exp(-((length / s) ** 2)) if length else 1.0 + clear
    wall = Affine([[1.0]], lambda xp: lambda t: -xp.exp(-(((t - c) / s) ** 2)) * xp.ones(1))
    return (
        np.array([y]),
        Complementarity(lambda xp: lambda t, x: 0.0 * x, (wall,)),
        np.array([1.0 if length else y]),
        c - length,
        c,
    )


def pick(index: int, seed: int) -> Passage:
    rng = np.random.default_rng([seed, index])
    kind = KINDS[index % len(KINDS)]
    fate = rng.choice(["contact", "clear", "touch"], p=[0.5, 0.4, 0.1])
    length = 10.0 ** rng.uniform(-3, np.log10(0.3)) if fate == "contact" else 0.0
    clear = 10.0 ** rng.uniform(-12, -2) if fate == "clear" else 0.0
    return passage(kind, length, clear, rng)


def judge(p: Passage) -> tuple[str, float, float]:
    """(verdict, error of event times, error of the end state): good, missed, invented, wrong or a
    status."""
    traj = solve(p.case, "event_driven")
    if not traj.status.ok:
        return traj.status.code, 0.0, 0.0
    kinds = [e.kind for e in traj.events]
    found = np.array([e.t for e in traj.events])
    off = float(np.abs(traj.x[-1] - p.end).max())
    if p.times and kinds != ["contact", "release"]:
        return ("missed" if "contact" not in kinds else "wrong"), 0.0, off
    if not p.times and kinds:
        return "invented", 0.0, off
    late = float(np.abs(found - p.times).max()) if p.times else 0.0
    return ("good" if off <= 1e-10 and late <= 1e-9 else "inaccurate"), late, off


def main(argv=None) -> int:
    """Run the study; returns the number of passages that are not good."""
    ap = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("--passages", 1000), ("--seed", 0), ("--first", 0)):
        ap.add_argument(name, type=int, default=default)
    o = ap.parse_args(argv)
    count = Counter()
    late = 0.0
    off = 0.0
    for k in range(o.first, o.first + o.passages):
        p = pick(k, o.seed)
        verdict, a, b = judge(p)
        count[verdict] += 1
        late = max(late, a)
        off = max(off, b)
        if verdict != "good":
            print(
                f"{k:4d} {p.case.name} {p.times} touch={p.touch}: {verdict}, times {a:.1e}, end "
                f"{b:.1e}",
                flush=True,
            )
    print(
        f"{o.passages} passages: {dict(count)}; largest error of event times {late:.1e}, of the "
        f"end state {off:.1e}"
    )
    return o.passages - count["good"]


if __name__ == "__main__":
    raise SystemExit(1 if main() else 0)
