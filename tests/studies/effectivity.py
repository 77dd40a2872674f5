"""Effectivity of error bars: over the true errors, for methods, cases and steps.

    python tests/studies/effectivity.py [CASE ...] [--steps 3] [--own 12 [--stiff | --changing]]
        [-s METHOD ...]
    python tests/studies/effectivity.py --prox-regular

One line for each case and method: whether its error bars are a bound or an estimate, the range of
the effectivity of state and reaction over the steps (largest error bar over the largest error, both
over the samples), and the least ratio of error bar and error at any sample whose error is above ten
times the bound of the reference. Then how many bounds were below an error at some sample, and how
many estimates had an effectivity outside 1 to 10, by name. --own N: N scenes drawn by a seed
instead, half of them points between oblique walls under turning drifts, half discs that are drawn
together in the plane and pulled about; event_driven is their truth. --stiff: points alone, pulled
by stiff springs. --changing: points alone, whose drift has a derivative that depends on time or
state, between walls of which half move. --prox-regular: by how much a bound that holds for discs,
which are no convex set, would grow along the exact motion.
"""

import argparse
import sys
import warnings

import numpy as np

import nsbench
from nsbench import Affine, Case, Complementarity, Distance
from nsbench.case import get_case
from nsbench.error_bars.growth import linear_drift
from nsbench.reference import reference
from nsbench.solvers import get

BOUNDS = ("rods[n=5]", "rods[n=10]", "rods_wall", "wedge", "wedge[psi=120]", "box_turning")
BOUNDS = (*BOUNDS, "box_turning[side=0.8]", "tide", "duplicate", "play", "moving_floor")
ESTIMATES = ("discs[n=3]", "discs[n=10]", "discs[n=30]", "hex", "stack", "chain", "obstacle")
ESTIMATES = (*ESTIMATES, "bean", "epithelium", "three_discs", "two_discs", "kissing", "wheel")
DISCS = ("two_discs", "three_discs", "hex", "discs[n=3]", "discs[n=10]", "discs[n=30]")
METHODS = ("pbd", "catching_up", "theta", "penalty", "richardson", "penalty[extrapolate=1]")
SOFTEST = 100.0  # times its unit: the least stiffness that is run
SEED = 20261125
EXACT = 1e-9  # of the size of the state: errors below are none that a method makes


def waves(A, B, rate, phase):
    """The drift A x + B cos(rate t + phase) in n dimensions: its factory."""

    def drift(xp):
        a, b, w, p = (xp.asarray(v + 0.0) for v in (A, B, rate, phase))

        def f(t, x):
            return a @ x + b @ xp.cos(w * t + p)

        return f

    return drift


def walls_scene(seed):
    """A point in 2 to 4 dimensions between oblique walls, under a drift that turns."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    N = rng.normal(size=(n + int(rng.integers(0, 3)), n))
    N /= np.linalg.norm(N, axis=1)[:, None]
    gaps = rng.uniform(0.1, 0.6, len(N))
    A = rng.normal(size=(n, n)) * 0.5
    B = np.diag(rng.uniform(0.5, 2.0, n))
    drift = waves(A, B, rng.uniform(1.0, 6.0, n), rng.uniform(0.0, 6.0, n))
    problem = Complementarity(drift, (Affine(A=N, b=gaps),))
    return Case(name=f"walls_{seed}", problem=problem, x0=np.zeros(n), t=np.linspace(0.0, 3.0, 31))


def stiff_scene(seed):
    """A point between the walls of walls_scene that springs pull to a place that goes round, at
    rates from 1 to 316: samples lie up to 30 times as far apart as the drift forgets."""
    rng = np.random.default_rng(seed)
    walls = walls_scene(seed)
    n = walls.n
    axes = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A = axes @ np.diag(10.0 ** rng.uniform(0.0, 2.5, n)) @ axes.T
    B = A @ np.diag(rng.uniform(0.3, 1.5, n))
    drift = waves(-A, B, rng.uniform(1.0, 6.0, n), rng.uniform(0.0, 6.0, n) - 0.5 * np.pi)
    problem = Complementarity(drift, walls.problem.constraints)
    return Case(name=f"stiff_{seed}", problem=problem, x0=np.zeros(n), t=walls.t)


def changing_scene(seed):
    """A point in 1 to 3 dimensions between oblique walls, which move for odd seeds, under a drift
    whose derivative swells and ebbs, or depends on the state, or both."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    N = rng.normal(size=(int(rng.integers(1, n + 3)), n))
    N /= np.linalg.norm(N, axis=1)[:, None]
    gaps = rng.uniform(0.2, 1.0, len(N))
    reach = rng.uniform(0.0, 0.3, len(N)) * (seed % 2)
    pace = rng.uniform(1.0, 5.0, len(N))
    A, swelling, bent = rng.normal(size=(3, n, n))
    period = rng.choice([1.0, 2.0, rng.uniform(0.7, 6.0)])
    swells, is_bent = ((1.0, False), (0.0, True), (1.0, True))[seed % 3]
    pull = 2.0 * rng.normal(size=n)

    def drift(xp):
        a, s, c, u = (xp.asarray(v + 0.0) for v in (A, swells * swelling, bent, pull))

        def f(t, x):
            y = a @ x + u * xp.sin(2.5 * t + 1.0)
            y = y + (1.0 - xp.cos(2.0 * np.pi / period * t)) * (s @ x)
            return y + xp.sin(2.0 * (c @ x)) if is_bent else y

        return f

    def walls(xp):
        g, r, w = (xp.asarray(v + 0.0) for v in (gaps, reach, pace))
        return lambda t: g + r * xp.sin(w * t)

    constraints = (Affine(A=N, b=walls if seed % 2 else gaps),)
    t = np.linspace(0.0, 2.0, 21)
    return Case(f"changing_{seed}", Complementarity(drift, constraints), np.zeros(n), t)


def discs_scene(seed):
    """Three to six discs that are drawn to a point which goes round, apart at the start."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(3, 7))
    angle = 2.0 * np.pi * np.arange(m) / m
    ring = (1.5 + rng.uniform(0.0, 0.6, m)) * (0.6 + 0.2 * m)
    x0 = np.stack([ring * np.cos(angle), ring * np.sin(angle)], 1).ravel()
    pull = rng.uniform(0.6, 1.4)
    turn = rng.uniform(1.0, 3.0)

    def drift(xp):
        ones = xp.asarray(np.tile([1.0, 0.0], m))
        side = xp.asarray(np.tile([0.0, 1.0], m))

        def f(t, x):
            return -pull * (x - 0.5 * (xp.cos(turn * t) * ones + xp.sin(turn * t) * side))

        return f

    problem = Complementarity(drift, (Distance(d=1.0, dim=2),))
    return Case(name=f"discs_{seed}", problem=problem, x0=x0, t=np.linspace(0.0, 2.5, 26))


def truth(case):
    """States, reactions and error of the reference, or of event_driven for a drawn scene."""
    ref = reference(case)
    if ref is not None:
        return ref.x, ref.reaction, ref.state_error
    traj = nsbench.solve(case, "event_driven")
    return (traj.x, traj.reaction, 1e-10) if traj.status.ok else None


def accuracies(case, method, count):
    """Steps from the spacing of the samples down, or stiffnesses up, by factors of 2.7."""
    method = get(method)
    factors = 2.7 ** np.arange(count)
    if method.accuracy == "k":
        return SOFTEST * method.accuracy_unit(case) * factors
    return float(np.diff(case.t).min()) / factors


def measured(case, method, value):
    """Effectivity of state and reaction, least ratio at a sample, and is it a bound?"""
    traj = nsbench.solve(case, method, **{get(method).accuracy: value})
    known = truth(case)
    if traj.status.code not in ("ok", "unverified", "degenerate") or known is None:
        return None
    x, reactions, doubt = known
    error = np.linalg.norm(traj.x - x, axis=1)
    size = max(1.0, float(np.abs(x).max()))
    if error.max() <= max(EXACT * size, 10.0 * doubt):
        return None
    seen = error > 10.0 * doubt + EXACT * size
    least = float((traj.bound.state[seen] / error[seen]).min())
    state = float(traj.bound.state.max() / error.max())
    reaction = np.nan
    if reactions is not None:
        off = np.linalg.norm(traj.reaction - reactions, axis=1)
        reaction = float(traj.bound.reaction.max() / off.max())
    return state, reaction, least, traj.bound.is_proven


def prox_growth(case) -> float:
    """Largest factor by which a rigorous bound lets errors grow among discs of one diameter.

    For normals p at x, q at y of a set that is prox-regular with the constant r,
    <p - q, x - y> >= -(|p| + |q|) / (2 r) |x - y|^2 (Poliquin, Rockafellar & Thibault 2000). So
    (|w|)' <= (L + (|p| + |q|) / (2 r)) |w| + |rho|. Forces of contacts are at most the drift,
    |q| <= |f|, and p is that of the run. r is taken as that of one pair, d / sqrt(2): of more discs
    it is smaller.
    """
    traj = nsbench.solve(case, "event_driven")
    drift = case.problem.drift(np)
    d = next(c.d for c in case.problem.constraints if isinstance(c, Distance))
    r = float(np.min(d)) / np.sqrt(2.0)
    f = np.array([np.linalg.norm(drift(t, x)) for t, x in zip(traj.t, traj.x, strict=True)])
    spent = np.diff(traj.t)
    p = np.linalg.norm(np.diff(traj.reaction, axis=0), axis=1) / spent
    J = linear_drift(drift, traj.t, traj.x)
    return float(np.exp((spent * (J.one_sided + (p + np.maximum(f[1:], f[:-1])) / (2 * r))).sum()))


def kinds(proven) -> str:
    """Return of which kind the error bars of the steps are: bound, estimate or both."""
    return "both" if proven.any() and not proven.all() else "bound" if proven.all() else "estimate"


def main():
    """Print the effectivities; exit status 1 if a bound was below an error."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("cases", nargs="*", default=[*BOUNDS, *ESTIMATES])
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--own", type=int, default=0, metavar="N")
    parser.add_argument("--stiff", action="store_true")
    parser.add_argument("--changing", action="store_true")
    parser.add_argument("-s", "--methods", nargs="+", default=METHODS)
    parser.add_argument("--prox-regular", action="store_true")
    args = parser.parse_args()
    if args.prox_regular:
        for name in DISCS:
            print(f"{name:24} errors may grow {prox_growth(get_case(name)):.3g} times")
        return 0
    warnings.simplefilter("ignore")
    below = []
    outside = []
    pairs = 0
    alone = stiff_scene if args.stiff else changing_scene if args.changing else None
    scenes = (alone,) if alone else (walls_scene, discs_scene)
    own = [scenes[k % len(scenes)](SEED + k) for k in range(args.own)]
    for case in own or map(get_case, args.cases):
        name = case.key
        for method in args.methods:
            if get(method).refuses(case):
                continue
            values = accuracies(case, method, args.steps)
            found = [m for v in values if (m := measured(case, method, v))]
            if not found:
                print(f"{name:24} {method:22} no error to compare with", flush=True)
                continue
            pairs += len(found)
            state, reaction, least, proven = (np.array(v) for v in zip(*found, strict=True))
            print(
                f"{name:24} {method:22} {kinds(proven):9}"
                f"state {state.min():.3g} .. {state.max():.3g}  reaction {np.nanmin(reaction):.3g}"
                f" .. {np.nanmax(reaction):.3g}  least {least.min():.4g}",
                flush=True,
            )
            for a, b, is_bound in zip(least, state, proven, strict=True):
                run = f"{name} {method}"
                below += [run] if is_bound and a < 1.0 else []
                outside += [run] if not is_bound and not 1.0 <= b <= 10.0 else []
    print(f"{pairs} runs; bounds below an error: {below or 0}")
    print(f"estimates outside 1 to 10: {outside or 0}")
    return int(bool(below))


if __name__ == "__main__":
    sys.exit(main())
