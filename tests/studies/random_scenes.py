"""Random scenes of hard discs, each run twice: other integrator, other tolerance. Silent
disagreements must be none.

    python tests/studies/random_scenes.py --scenes 500 --seed 0 [--first K] [--most 30]

A scene is one of KINDS with 3 to 30 discs under a smooth random drift (attraction, rotation, waves
in space and time).
Both runs must agree to 1e-8 in state and reaction at every sample, relative to max(1, size), or one
of them must have a status that is not ok. Multipliers are not compared: they need not be unique.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from nsbench import Affine, Case, Complementarity, Distance  # noqa: E402
from nsbench.solvers import solve  # noqa: E402

AGREE = 1e-8
KINDS = ("free", "box", "closing_box", "links", "duplicate", "lattice", "mirror", "obstacles")
ROW = 0.75**0.5


def waves(rng, n, mirror=False):
    """Factory of the drift: -a (x - c) + w J x + waves + a constant kick per disc; mirrored pairs
    stay mirrored."""
    a = rng.uniform(0.3, 1.5)
    w = rng.uniform(-1.0, 1.0)
    m = 2
    K = rng.uniform(-1.0, 1.0, (m, 2))
    omega = rng.uniform(-3.0, 3.0, m)
    phase = rng.uniform(0.0, 6.0, m)
    amp = rng.uniform(-0.4, 0.4, (m, 2))
    kick = rng.uniform(-0.3, 0.3, (n, 2))
    if mirror:  # f(S x) = S f(x) with S (u, v) = (-u, v)
        w = 0.0
        K[:, 0] = 0.0
        amp[:, 0] = 0.0
        kick[n // 2 :] = kick[: n // 2] * [-1.0, 1.0]
    push = kick.ravel()
    turn = w * np.tile([-1.0, 1.0], n)

    def drift(xp):
        def f(t, x):
            p = x.reshape((-1, 2))
            out = push - a * x + turn * p[:, ::-1].flatten()
            for k in range(m):
                s = xp.sin(p[:, 0] * K[k, 0] + p[:, 1] * K[k, 1] + omega[k] * t + phase[k])
                out = out + xp.stack((amp[k, 0] * s, amp[k, 1] * s), axis=1).flatten()
            return out

        return f

    return drift


def scattered(rng, n, spacing):
    """n sites of a triangular lattice near a random point, jittered so that all stay 2 apart: (n,
    2)."""
    side = int(np.ceil(np.sqrt(n))) + 4
    j, i = np.divmod(np.arange(side * side), side)
    sites = np.stack((i + 0.5 * (j % 2), ROW * j), axis=1)
    centre = sites.mean(axis=0) + rng.random(2)
    p = spacing * (
        sites[np.argsort(np.sum((sites - centre) ** 2, axis=1), kind="stable")[:n]] - centre
    )
    angle = rng.uniform(0.0, 2 * np.pi, n)
    reach = 0.49 * (spacing - 2.0) * np.sqrt(rng.random(n))
    return p + reach[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=1)


def walls(n, half, speed=0.0):
    """Four walls at +-half around all discs, closing with `speed` (1 - cos t)."""
    A = np.vstack((np.eye(2 * n), -np.eye(2 * n)))
    if speed == 0.0:
        return Affine(A, np.full(4 * n, half))
    return Affine(A, lambda xp: lambda t: (half - speed * (1.0 - xp.cos(t))) * xp.ones(4 * n))


def scene(kind: str, n: int, seed: int) -> Case:
    """The scene of that kind with about n discs."""
    rng = np.random.default_rng([seed, n, KINDS.index(kind)])
    hard = Distance(d=2.0)
    n = 2 * max(2, n // 2) if kind == "mirror" else n
    x = scattered(rng, n, rng.uniform(2.2, 3.2))
    more = ()
    drift = waves(rng, n, kind == "mirror")
    half = float(np.abs(x).max()) + rng.uniform(0.05, 0.5)
    if kind == "box":
        more = (walls(n, half),)
    elif kind == "closing_box":
        more = (walls(n, half, rng.uniform(0.05, 0.15)),)
    elif kind == "links":
        i = np.arange(n - 1)
        length = np.hypot(*(x[1:] - x[:-1]).T) + rng.uniform(0.01, 0.5, n - 1)
        more = (Distance(d=length, sign=-1, pairs=np.stack((i, i + 1), axis=1)),)
    elif kind == "duplicate":
        more = (Distance(d=2.0), walls(n, half), walls(n, half))
    elif kind == "lattice":  # starts closed and redundant
        x = scattered(np.random.default_rng(0), n, 2.0)
        x -= x.mean(axis=0)
    elif kind == "mirror":
        x = scattered(rng, n, 2.6)
        x = x[: n // 2] - [x[: n // 2, 0].min() - 1.0 - rng.uniform(0.05, 0.4), 0.0]
        x = np.concatenate((x, x * [-1.0, 1.0]))
    elif kind == "obstacles":
        post = np.array([[0.0, half + 2.6], [-half - 2.1, 0.0]])
        c, s = rng.uniform(0.5, 1.5, 2)
        still = post[:1]
        moving = post[1]
        more = (
            Distance(d=2.5, anchors=still),
            Distance(
                d=2.0,
                anchors=lambda xp: (
                    lambda t: xp.stack((moving[0] + c * t, s * xp.sin(t))).reshape((1, 2))
                ),
            ),
        )
    return Case(
        name=f"scene_{kind}",
        problem=Complementarity(drift, (hard, *more)),
        x0=x.ravel(),
        t=np.linspace(0.0, 2.0, 11),
        params={"n": n, "seed": seed},
    )


def pick(index: int, seed: int, most: int = 30):
    """(kind, n) of scene number `index`: kinds in turn, sizes random."""
    rng = np.random.default_rng([seed, index, 7])
    return KINDS[index % len(KINDS)], int(rng.integers(3, most + 1))


def differ(a, b) -> float:
    """Largest difference of states and reactions at samples, relative to max(1, size)."""
    pairs = ((a.x, b.x), (a.reaction, b.reaction))
    return max(float(np.nanmax(np.abs(u - v) / np.maximum(1.0, np.abs(v)))) for u, v in pairs)


def twice(case: Case):
    """The run at default settings and one by another integrator at another tolerance."""
    other = (
        ("event_driven[method=radau]", 3e-10)
        if case.n <= 10
        else ("event_driven[method=rk45]", 1e-10)
    )
    return solve(case, "event_driven"), solve(case, other[0], tol=other[1])


def main(argv=None) -> int:
    """Run the study; returns the number of silent disagreements."""
    ap = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("--scenes", 500), ("--seed", 0), ("--first", 0), ("--most", 30)):
        ap.add_argument(name, type=int, default=default)
    o = ap.parse_args(argv)
    count = Counter()
    told = Counter()
    silent = 0
    worst = 0.0
    begin = time.perf_counter()
    for k in range(o.first, o.first + o.scenes):
        kind, n = pick(k, o.seed, o.most)
        start = time.perf_counter()
        a, b = twice(scene(kind, n, k))
        took = time.perf_counter() - start
        count[kind] += 1
        if not (a.status.ok and b.status.ok):
            told[kind] += 1
            print(
                f"{k:4d} {kind} n={n}: {a.status.code} / {b.status.code} ({took:.1f} s): "
                f"{a.status} | {b.status}",
                flush=True,
            )
            continue
        d = differ(a, b)
        worst = max(worst, d) if d <= AGREE else worst
        if not d <= AGREE:
            silent += 1
            print(
                f"{k:4d} {kind} n={n}: DISAGREE by {d:.2e}, {len(a.events)} / {len(b.events)} "
                f"events ({took:.1f} s)",
                flush=True,
            )
        if (k + 1) % 50 == 0 or took > 60.0:
            print(
                f"{k:4d} {kind} n={n}: {took:.0f} s; largest agreed difference so far {worst:.1e}",
                flush=True,
            )
    print(
        f"{o.scenes} scenes {dict(count)}; not ok: {sum(told.values())} {dict(told)}; silent "
        f"disagreements: {silent}; "
        f"largest agreed difference {worst:.1e}; {time.perf_counter() - begin:.0f} s"
    )
    return silent


if __name__ == "__main__":
    raise SystemExit(1 if main() else 0)
