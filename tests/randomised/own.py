"""Own residuals: a run held against its equation alone, with as many samples as that takes.

What a run lacks over an interval is its residual there times the length, a way; `missing` is what
all intervals lack. A kink or a jump of the drift inside an interval deceives the quadrature by a
way that shrinks with the interval, by its length or faster; a velocity that is wrong for a while, a
jump or a push that is not the equation's lack the same whatever the samples.
"""

from __future__ import annotations

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.filippov.switch_rates import switch_range
from nsbench.measure.context import context_of, near_of
from nsbench.measure.residuals import interval_residuals
from nsbench.problem import Complementarity, Distance, Filippov
from randomised.ladder import EPS, is_slow, stiffness
from randomised.runs import Verdict, attempt

ROUNDS = (
    12  # of finer samples where something is missing: 4^12 times finer than the finest even ones
)
WORST = 40  # intervals that a round divides at most
# of the way that the largest velocity makes in a run: may be missing of one that claims a bound
MISSING = 1e-7
OWN = 1e-5  # the same for steps
STEPS = (
    8,
    32,
    128,
    512,
    2048,
)  # of a sample spacing, each a sample; more where there are few samples
STIFF = (
    100.0,
    400.0,
    1600.0,
    6400.0,
)  # and k with PARTS samples to a spacing, four times as many each time
PARTS = 40
# samples of the coarsest, and of any run (a fourth of that where loops are slow)
LEAST = 240
NODES = 12000
STAYS = 0.5  # what does not fall to that with sixteen times finer steps stays
FAST = 0.005  # of the unit: where most steps still move by more, no order can be seen yet
NARROW = 0.1  # of the shortest link or diameter: the same
SLOW = 0.1  # step x rate of the drift: with more, explicit steps of it are not yet small
LOOK = 20  # samples from one to the next at which switches are looked at for their size
NAMES = "missing", "depth", "complementarity"


def missing(case, traj) -> np.ndarray:
    """(k - 1,) the way that each interval lacks."""
    with np.errstate(all="ignore"):
        return interval_residuals(context_of(case), traj) * np.diff(traj.t)


def finer(t: np.ndarray, lacks: np.ndarray) -> np.ndarray:
    """t with three more times in each of the intervals that lack most and their neighbours."""
    bad = np.argsort(-lacks)[:WORST]
    bad = bad[lacks[bad] > 1e-2 * lacks[bad[0]]]
    bad = np.unique(np.clip(bad[:, None] + np.arange(-2, 3), 0, len(lacks) - 1))
    bad = bad[np.diff(t)[bad] > 1e-12 * max(1.0, float(np.abs(t).max()))]
    return np.unique(
        np.concatenate([t, *(t[bad] + s * np.diff(t)[bad] for s in (0.25, 0.5, 0.75))])
    )


def filled(run, case, t, allowed: float):
    """What is missing, round by round, until it is at most `allowed` (a way) or divided samples do
    not help.

    run(t) -> a trajectory that says ok with samples t, or None (told otherwise). The list, and the
    last trajectory or None.
    """
    found = []
    for _ in range(ROUNDS):
        traj = run(t)
        if traj is None:
            return found, None
        lacks = np.nan_to_num(missing(case.replace(t=t), traj), nan=np.inf)
        found.append(float(lacks.sum()))
        more = finer(t, lacks)
        if found[-1] <= allowed or not np.isfinite(found[-1]) or len(more) == len(t):
            return found, traj
        t = more
    return found, traj


def settled(case, spec: str, method, unit: float, why: str) -> Verdict:
    """A method of a claimed order where there is no answer: do its defects fall with finer steps,
    or stay?

    Defects are what is missing in all intervals, the greatest depth, and the integral of gap x
    multiplier, with each step a sample.
    """
    found = []
    bad = None
    for v, t in _fine(case, spec, method):
        run = attempt(case.replace(t=t), spec, v)
        if run.crash:
            return Verdict("crash", "", f"at {v:g} with more samples: {run.crash}")
        if not run.ok:
            return Verdict("open", "ok", why)
        defects, sizes = _defects(case.replace(t=t), run, unit)
        found.append(defects)
        if len(found) < 3:
            continue
        # relative to the finest run: coarse ones of a stiff drift are of any size
        each = [
            (name, values)
            for name, values in zip(NAMES, _relative(np.array(found), sizes).T, strict=True)
            if not values[-1] <= max(OWN, STAYS * max(values[:-2]))
        ]
        if not each:
            return Verdict("own", "ok", why)
        bad = [
            f"{name} {', '.join(f'{v:.1e}' for v in values)}"
            for name, values in each
            if not values[-1] <= STAYS * values[-2]
        ]  # else it falls at last: nothing is known
    if not found:
        return Verdict("open", "ok", why)
    step = float(np.median(np.abs(np.diff(run.traj.x, axis=0)).max(axis=1)))
    if (
        not bad
        or float(np.diff(t).min()) * _rate(case, run.traj) > SLOW
        or step > min(FAST * unit, NARROW * shortest(case))
    ):
        return Verdict("open", "ok", why)
    return Verdict("wrong", "ok", "; ".join([*bad, why]))


def _relative(found, sizes):
    """Over what they are held against; nothing of nothing is none."""
    return np.divide(
        found, sizes, out=np.where(found == 0.0, 0.0, np.inf), where=np.array(sizes) > 0.0
    )


def coincide(case) -> bool:
    """Whether two surfaces of a Filippov system are one: their switches agree in sign, or never do,
    at 200 points."""
    if not isinstance(case.problem, Filippov):
        return False
    rng = np.random.default_rng(0)
    size = max(1e-8, float(np.abs(case.x0).max()))
    switch = case.problem.switch(np)
    with np.errstate(all="ignore"):
        c = np.sign(
            [
                switch(rng.uniform(case.t[0], case.t[-1]), size * rng.uniform(-2.0, 2.0, case.n))
                for _ in range(200)
            ]
        )
    agree = np.abs(c.T @ c) == len(c)
    return bool(np.any(agree & ~np.eye(len(agree), dtype=bool)))


def slope(case) -> float:
    """Largest gradient of rows, at least 1: a depth is in units of the gap."""
    p = case.problem
    rows = [np.abs(c.data).max() for c in getattr(p, "constraints", ()) if hasattr(c, "data")]
    rows += [float(np.abs(p.C).max())] if hasattr(p, "C") else []
    return max([1.0, *rows])


def shortest(case) -> float:
    """The shortest length of links and the least diameter of particles; infinite where there is
    none."""
    hard = [c for c in getattr(case.problem, "constraints", ()) if isinstance(c, Distance)]
    return min([float(np.min(2.0 * c.radii if c.d is None else c.d)) for c in hard], default=np.inf)


def _rate(case, traj) -> float:
    """The largest rate of the drift, or of the field beside the surfaces, row sums of its Jacobian
    by differences, at some samples; 0 of an LCS."""
    p = case.problem
    if not isinstance(p, (Complementarity, Filippov)):
        return 0.0
    f = p.drift(np) if isinstance(p, Complementarity) else None
    worst = 0.0
    for k in np.unique(np.linspace(0, len(traj.t) - 1, 20).astype(int)):
        t = traj.t[k]
        x = traj.x[k]
        if isinstance(p, Filippov):
            signs = np.where(np.asarray(p.switch(np)(t, x.copy())) >= 0.0, 1.0, -1.0)
            f = lambda t, x, s=signs: p.field(np)(t, x, s)
        steps = 1e-6 * np.maximum(1e-3 * np.abs(x).max(initial=0.0), np.abs(x)) + 1e-300
        J = np.array(
            [(f(t, x + d * e) - f(t, x)) / d for d, e in zip(steps, np.eye(len(x)), strict=True)]
        )
        worst = max(worst, float(np.nan_to_num(np.abs(J).sum(axis=0), nan=np.inf).max()))
    return worst


def _fine(case, spec, method):
    """(h or k, samples): every step a sample, as many as NODES allows."""
    spacing = np.diff(case.t)
    if any(
        word in spec for word in ("richardson", "extrapolate", "nosnoc")
    ):  # whose steps are no motion, or 0.1 s each
        return
    if method.accuracy == "k":
        parts = max(PARTS, -(-LEAST // len(spacing)))
        for j, k in enumerate(STIFF):  # what the samples hide of jumps of the drift falls too
            if 4**j * parts * len(spacing) <= NODES or j < 3:
                yield k * stiffness(case), _even(case.t, 4**j * parts)
        return
    base = max(1, -(-LEAST // (STEPS[0] * len(spacing))))
    most = NODES // (4 if is_slow(case, spec) else 1)
    for n in STEPS:
        if base * n * len(spacing) <= most:
            t = _even(case.t, base * n)
            yield float(np.diff(t).min()), t


def _even(t, parts):
    """`parts` times as many samples, evenly: between uneven ones a step would not be a sample."""
    return np.linspace(t[0], t[-1], parts * (len(t) - 1) + 1)


def _defects(case, run, unit):
    """The three defects of a run, and what they are to be held against."""
    traj = run.traj
    size = max(unit, float(np.abs(np.diff(traj.x, axis=0) / np.diff(traj.t)[:, None]).max()))
    T = float(traj.t[-1] - traj.t[0])
    moved = max(unit, float(np.abs(traj.x - traj.x[0]).max()))
    first = (
        len(traj.t) // 2 if case.start == "keep" else 0
    )  # that may be infeasible, and is mended in some steps
    lacks = float(np.nan_to_num(missing(case, traj), nan=np.inf)[first:].sum())
    scene = context_of(case).scene
    depth = (
        max(scene.max_violation(a, b) for a, b in zip(traj.t[first:], traj.x[first:], strict=True))
        / slope(case)
        if scene
        else 0.0
    )
    across = size * moved
    if isinstance(case.problem, Filippov):
        across = float(switch_range(case.problem.switch(np), float(traj.t[-1]), traj.x, unit).max())
    return (lacks, depth, _apart(case, run, first)), (size * T, moved, across * T)


def _apart(case, run, first: int) -> float:
    """The integral of gap x multiplier, gaps being the lesser one of both ends; of a Filippov
    system the greatest product of a switch function and the weight of its other side, times the
    run; 0 of an LCS."""
    traj = run.traj
    p = case.problem
    if isinstance(p, Filippov):
        rounded = EPS * float(
            max(np.abs(traj.t[[0, -1]]).max(), np.ptp(traj.t)) / np.diff(traj.t).min()
        )  # of a mean weight
        looks = zip(traj.t[::LOOK], traj.x[::LOOK], strict=True)
        across = max(float(np.abs(as_numpy(p.switch)(t, x.copy())).max()) for t, x in looks)
        return max(0.0, run.measured["complementarity"] - rounded * across) * float(
            traj.t[-1] - traj.t[0]
        )
    if not isinstance(p, Complementarity) or not traj.contacts:
        return 0.0
    scene = context_of(case).scene
    near = near_of(scene, traj.contacts)
    places = scene.layout(near)
    gaps = np.maximum(
        [scene.gaps(t, x, near, places) for t, x in zip(traj.t, traj.x, strict=True)], 0.0
    )
    return float(
        (np.minimum(gaps[:-1], gaps[1:]) * np.maximum(np.diff(traj.impulse, axis=0), 0.0))[
            first:
        ].sum()
    )
