"""The extent of a scene: what a violated constraint is held against, in any unit and anywhere."""
from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.contacts import ANCHOR, SMOOTH, Scene

TIMES = 200              # of a run at which walls and anchors are looked at


@functools.lru_cache(maxsize=64)
def scene_of(case: Case) -> Scene:
    return Scene(case.problem, case.n)


@functools.lru_cache(maxsize=64)
def size(case: Case) -> tuple[float, float]:
    """`extent` over the run."""
    scene = scene_of(case)
    return extent(scene, case.x0, np.linspace(case.t[0], case.t[-1], TIMES if scene.moving else 1))


def extent(scene: Scene, x0: np.ndarray, times) -> tuple[float, float]:
    """The farthest that a wall or an anchor is from the start (distances of links and particles count too), and the largest
    coordinate, which says what rounding is. 1 and more where there are smooth constraints: their gaps are no lengths."""
    norm, near = np.sqrt(scene.inv2), scene.all_static()
    tied = near.take(near.kind == ANCHOR)
    axes = np.arange(tied.dim.min(initial=3) if len(tied) else 0)
    far = max([float(SMOOTH in near.kind), _largest(near.d), *(2.0 * _largest(r) for r in scene.radii.values())])
    coordinate = _largest(x0)
    for t in times:
        b, anchors = scene.b(float(t)), scene.anchors(float(t))
        away = x0[tied.p[:, None] + axes] - anchors[tied.q[:, None] + axes]
        far = max(far, _largest(walls(scene, b, x0) * norm), _largest(away))
        coordinate = max(coordinate, _largest(b * norm), _largest(anchors))
    return far, coordinate


def walls(scene: Scene, b, x):
    """(rows,) gaps of the walls at x."""
    return np.add.reduceat(scene.vals * x[scene.cols], scene.ptr[:-1]) + b if b.size else b


def _largest(v) -> float:
    return float(np.abs(v).max(initial=0.0))
