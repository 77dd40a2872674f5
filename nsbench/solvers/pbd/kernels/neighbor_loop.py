"""Time loop of PBD with neighbour lists of hard particles, bit-identical to the sweep of all pairs.

A list holds every pair whose gap was at most the skin when it was built (a Verlet list). As long as
no particle has moved by more than skin / 2 since, a pair outside the list cannot overlap, and
leaving it out changes nothing. The displacement is checked after the drift and after every single
projection; when it is exceeded in the middle of a sweep, the list is built anew at the present
positions and the sweep goes on behind the constraint it had reached: nothing is undone, and no pair
is missed.
"""

from __future__ import annotations

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inlined, njit
from nsbench.dynamics.contacts.kernels.constraint_order import static_keys
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.solvers.common.kernels.step_code import StepCode, all_finite
from nsbench.solvers.pbd.kernels.listed_sweep import (
    NeighborList,
    any_beyond,
    first_after,
    renew,
    sweep_on,
)
from nsbench.solvers.pbd.kernels.loop_result import LoopResult
from nsbench.solvers.pbd.kernels.neighbor_list import HardScene, near_list

__all__ = ["HardScene", "march"]

QUARTER = 0.2499  # (skin / 2)^2 over skin^2, less rounding
REBUILDS_IN_A_STEP = 4  # beyond, the sweep is violent: longer lists, fewer of them
CALM_STEPS = 8  # steps with one list at most, after which a skin that was widened shrinks


@inlined
def sweep_step(near, skin, scene, listed_keys, rows, b, anchors, x, base, sweeps, most):
    """Do the sweeps of one step on x (n,), over lists that are certified for it.

    near: NeighborList; base (n,): where it was built; listed_keys: of the listed constraints; most:
    entries of a list above which the skin is not widened. Returns the NeighborList, the skin, the
    lists built, the projections done, and whether centres coincided.
    """
    broken = any_beyond(x, base, scene.hard, QUARTER * skin * skin)
    inside = 0
    work = 0
    any_tied = False
    for _ in range(sweeps):
        c = 0
        last = np.uint64(0)
        # Gauss-Seidel sweep, interrupted by a new list wherever a particle leaves its own
        while True:
            if broken:
                if inside > REBUILDS_IN_A_STEP and near.keys.size < most:
                    skin *= 1.5
                near = renew(near, x, base, skin, scene, listed_keys)
                inside = inside + 1
                c = first_after(near.keys, last) if c > 0 else c
            c, done, tied, broken = sweep_on(
                c,
                near.contacts,
                near.mu,
                rows,
                b,
                anchors,
                x,
                base,
                scene.owner,
                QUARTER * skin * skin,
            )
            work += done
            any_tied = any_tied or tied
            if not broken:
                break
            last = near.keys[c - 1]
    return near, skin, inside, work, any_tied


@njit(cache=True)
def march(
    f, b_of, a_of, moving, t, substeps, sweeps, x, scene, rows, b, anchors, reach
) -> LoopResult:
    """Integrate from x (n,); arguments as listed_loop.march, scene: HardScene, reach: least skin.

    Returns a LoopResult.
    """
    scene, rows = borrowed((scene, rows))
    K = t.size
    X = np.full((K, x.size), np.nan)
    R = np.full((K, x.size), np.nan)
    x = x.copy()
    reac = np.zeros(x.size)
    v = np.empty(x.size)
    base = x.copy()
    ids = np.empty((64, 4), np.int64)
    values = np.empty(64)
    size = 0
    listed_keys = static_keys(scene.static.family, scene.order, scene.seed)
    contacts, keys = near_list(x, reach, scene, listed_keys)
    near = NeighborList(contacts, keys, np.zeros(keys.size), 1, keys.size)
    most = 3 * scene.hard[:, 2].sum() + listed_keys.size
    X[0] = x
    R[0] = reac
    work = 0
    code = StepCode.OK
    skin = reach
    calm = 0
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            f(now, x, v)
            for c in range(x.size):
                x[c] += h * v[c]
                v[c] = x[c]
            if not all_finite(x):
                end = StepCode.NAN, now, near.rebuilds, near.peak
                return LoopResult(X, R, ids[:size], values[:size], work, *end)
            if moving:
                after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
                b_of(after, b)
                a_of(after, anchors)
            near, skin, inside, done, tied = sweep_step(
                near, skin, scene, listed_keys, rows, b, anchors, x, base, sweeps, most
            )
            work += done
            code = StepCode.TIED if tied else code
            calm = calm + 1 if inside <= 1 else 0
            if calm > CALM_STEPS and skin > reach:  # calm again: short lists
                skin = max(reach, skin / 1.5)
                calm = 0
            for c in range(x.size):
                reac[c] += x[c] - v[c]
        X[k + 1] = x
        R[k + 1] = reac
        at = near.contacts
        ids, values, size = flush(k + 1, near.mu, at.family, at.i, at.j, ids, values, size)
    end = code, t[K - 1], near.rebuilds, near.peak
    return LoopResult(X, R, ids[:size], values[:size], work, *end)
