"""What a violated constraint is held against: its own numbers, in any unit and anywhere."""
from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.contacts import PAIR, Scene
from nsbench.near import Near
from nsbench.solvers._units import unit

TOLERANCE = 1e-9          # of a length of the scene; a start that misses by less is the rounding of whoever made it
LEAST = 1e-6              # unit: a start of 1e-16 may be a difference of numbers about 1
ROUNDED = 1e-10           # of the coordinates that a gap is made of: the same


@functools.lru_cache(maxsize=64)
def scene_of(case: Case) -> Scene:
    return Scene(case.problem, case.n)


def tolerances(case: Case, scene: Scene, t: float, x: np.ndarray, near: Near) -> np.ndarray:
    """(m,) what the gaps of `near` at (t, x) may be below zero, each in its own unit.

    A distance: TOLERANCE of itself, or of the unit of the case if that is more; a row: of the unit, times its length; both
    ROUNDED of the numbers that they are the difference of. A smooth constraint, whose gap is no length: of the largest
    coordinate, 1 at least.
    """
    length, places, largest = _unit(case), scene.places(near), float(np.abs(x).max(initial=0.0))
    out = np.full(len(near), TOLERANCE * max(1.0, largest))
    for kind, sel, i, j in places.pairs:
        at = np.abs(x[i]).max(axis=1) + np.abs(x[j] if kind == PAIR else scene.anchors(t)[j]).max(axis=1)
        out[sel] = TOLERANCE * np.maximum(near.d[sel], length) + ROUNDED * at
    if places.rows.size:
        row = near.p[places.rows]
        terms = np.add.reduceat(np.abs(scene.vals * x[scene.cols]), scene.ptr[:-1]) + np.abs(scene.b(t))
        out[places.rows] = TOLERANCE * length / np.sqrt(scene.inv2[row]) + ROUNDED * terms[row]
    return out


def misses(case: Case, scene: Scene, t: float, x: np.ndarray) -> bool:
    """Whether x (n,) violates a constraint at t by more than it may; what is no number does."""
    near = scene.near(x, 0.0, t)
    g = scene.gaps(t, x, near)
    return bool(np.any(~(g >= 0.0) & ~(np.isfinite(g) & (g >= -tolerances(case, scene, t, x, near)))))


@functools.lru_cache(maxsize=64)
def _unit(case: Case) -> float:
    try:
        return max(unit(case, case.x0), LEAST)
    except Exception:                                    # of a drift that raises, which is told where it is called for
        return 1.0
