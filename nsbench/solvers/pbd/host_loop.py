"""Position-based dynamics for scenes with Smooth constraints: the same sweep, driven from Python.

Smooth constraints are projected on by Newton's method for the nearest point of {g_k >= 0}; the
others by the kernels of the compiled loop, run by run in the stated order. Hard particles are taken
over all pairs.
"""

from __future__ import annotations

import itertools

import numpy as np

from nsbench.dynamics.contacts.constraint_set import SMOOTH

NEWTON = 30  # a projection that has not settled by then is reported


def prepare(method, case, scene, g, x0):
    """A zero-argument march that returns what kernels.pbd.march returns."""
    from nsbench.compilation.factories import as_numpy
    from nsbench.solvers.pbd.kernels import listed_loop

    near = scene.near(x0, np.inf, float(case.t[0]))
    near = near.take(np.argsort(_keys(scene, near, method, x0)))
    runs = _runs(near.kind)
    f = as_numpy(case.problem.drift)

    def march():
        with np.errstate(all="ignore"):  # what overflows ends the run, and is told by its status
            return steps()

    def steps():
        X = np.full((len(g.t), case.n), np.nan)
        R = np.full((len(g.t), case.n), np.nan)
        x = x0.copy()
        reac = np.zeros(case.n)
        mu = np.zeros(len(near))
        work = 0
        code = listed_loop.OK
        X[0] = x
        R[0] = reac
        ids = []
        values = []
        for k in range(len(g.t) - 1):
            h = (g.t[k + 1] - g.t[k]) / g.substeps[k]
            for s in range(g.substeps[k]):
                now = g.t[k] + s * h
                after = g.t[k] + (s + 1) * h
                y = x + h * np.asarray(f(now, x), float)
                if not listed_loop.finite(y):
                    return X, R, _ids(ids), np.array(values), work, listed_loop.NAN, now
                x = y.copy()
                for _ in range(method.sweeps):
                    done, code = _sweep(scene, near, runs, after, x, mu, code)
                    work += done
                reac = reac + (x - y)
            X[k + 1] = x
            R[k + 1] = reac
            for c in np.flatnonzero(mu):
                ids.append((k + 1, near.family[c], near.i[c], near.j[c]))
                values.append(mu[c])
            mu[:] = 0.0
        return X, R, _ids(ids), np.array(values), work, code, g.t[-1]

    return march


def _keys(scene, near, method, x0):
    """Keys of all constraints; in the orders by pairs those of hard families count by their
    particles."""
    from nsbench.dynamics.contacts.kernels.constraint_order import static_keys, sweep_key
    from nsbench.solvers.pbd.sweep_order import hard_ranks

    keys = static_keys(near.family, method.rank, method.seed)
    if method.order not in ("cell", "coloured"):
        return keys
    rank = hard_ranks(scene, method.order, x0)
    at = 0
    for k, _, m in scene.hard:
        number = rank[at : at + m] if rank.size else np.arange(m)
        at += m
        for c in np.flatnonzero(near.family == k):
            a, b = sorted((number[near.i[c]], number[near.j[c]]))
            keys[c] = sweep_key(method.rank, method.seed, k, a, b)
    return keys


def _ids(ids):
    return np.array(ids, np.int64).reshape(-1, 4)


def _runs(kind):
    """Maximal runs of entries that are all smooth or all not: (first, end, smooth)."""
    cut = np.flatnonzero(np.diff((kind == SMOOTH).astype(int))) + 1
    edges = [0, *cut.tolist(), len(kind)]
    return [(a, b, bool(kind[a] == SMOOTH)) for a, b in itertools.pairwise(edges) if b > a]


def _sweep(scene, near, runs, t, x, mu, code):
    from nsbench.solvers.pbd.kernels.listed_loop import TIED
    from nsbench.solvers.pbd.kernels.projection import sweep

    kind, _, _, _, p, q, d, sign, dim = near.arrays()
    b = scene.b(t)
    anchors = scene.anchors(t)
    work = 0
    for first, end, smooth in runs:
        if smooth:
            for c in range(first, end):
                m = project_smooth(scene.smooth(near.q[c]), int(near.p[c]), t, x)
                mu[c] += m
                work += m > 0.0
        else:
            done, tied = sweep(
                first,
                end,
                1,
                kind,
                p,
                q,
                d,
                sign,
                dim,
                x,
                scene.ptr,
                scene.cols,
                scene.vals,
                scene.inv2,
                b,
                anchors,
                mu,
            )
            work = work + done
            code = TIED if tied else code
    return work, code


def project_smooth(rows, k, t, x):
    """Move x to the nearest point of {g_k >= 0}: y - x = m grad g(y), g(y) = 0; returns m >= 0.

    Newton on m with the gradient taken at the newest point; the first step is the projection on the
    tangent.
    """
    y = x.copy()
    m = 0.0
    for _ in range(NEWTON):
        g = rows.g(t, y)[k]
        if m == 0.0 and g >= 0.0:
            return 0.0
        grad = rows.gradient(t, y)[k]
        size = float(grad @ grad)
        if size == 0.0 or not np.isfinite(size):
            break  # no direction to go: the violation stays, and is measured
        step = -g / size
        m = max(0.0, m + step)
        new = x + m * grad
        done = float(np.abs(new - y).max()) <= 1e-15 * (1.0 + float(np.abs(y).max()))
        y = new
        if done:
            break
    x[:] = y
    return m
