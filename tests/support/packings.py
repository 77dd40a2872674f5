"""Steps of near-jammed discs for the tests of what solves them: rows G, right-hand side q, and
their fronts."""

import numpy as np
from scipy.sparse import csr_array, vstack

from nsbench.compilation.decorators import python_entry
from nsbench.linalg import nested_dissection
from nsbench.qp.kernels import active_set


def packing(rng, n, crystal):
    """Centres of n unit discs that nearly all touch: a triangular lattice, or one shaken apart and
    drawn together."""
    side = int(np.ceil(np.sqrt(n)))
    j, i = np.divmod(np.arange(side * side), side)
    x = 2.0 * np.stack((i + 0.5 * (j % 2), 0.75**0.5 * j), 1)[:n]
    if not crystal:
        x = 1.1 * x + rng.uniform(-0.1, 0.1, x.shape)
        x = nsbench_pull(x)
    return x


def nsbench_pull(x):
    import nsbench
    from nsbench import Case, Complementarity, Distance

    middle = np.tile(x.mean(0), len(x))

    def drift(xp):
        def f(t, y):
            return 0.3 * (middle - y)

        return f

    case = Case(
        "pull",
        Complementarity(drift, (Distance(2.0),)),
        x.ravel(),
        np.array([0.0, 1.0]),
        start="keep",
    )
    return nsbench.solve(case, "pbd[sweeps=20]", h=0.01).x[-1].reshape(-1, 2)


def step(rng, n, crystal=False, walls=True):
    """Rows G and right-hand side q of a step with random velocities towards the middle."""
    x = packing(rng, n, crystal)
    i, j = np.triu_indices(n, 1)
    e = x[i] - x[j]
    r = np.hypot(*e.T)
    near = r < 2.3
    i = i[near]
    j = j[near]
    e = e[near] / r[near, None]
    r = r[near]
    k = np.arange(len(i))
    G = csr_array(
        (
            np.concatenate([e[:, 0], e[:, 1], -e[:, 0], -e[:, 1]]),
            (np.tile(k, 4), np.concatenate([2 * i, 2 * i + 1, 2 * j, 2 * j + 1])),
        ),
        shape=(len(i), 2 * n),
    )
    g = r - 2.0
    if walls:  # a floor under all discs, rows of another length
        G = vstack(
            [
                G,
                csr_array(
                    (np.full(n, 3.0), (np.arange(n), 2 * np.arange(n) + 1)), shape=(n, 2 * n)
                ),
            ]
        ).tocsr()
        g = np.append(g, 3.0 * (x[:, 1] - x[:, 1].min() + 1e-3))
    move = 0.01 * (rng.normal(size=x.shape) - 0.3 * (x - x.mean(0)) - [0.0, 1.0])
    return csr_array(G), g + G @ move.ravel()


def ready(G):
    G = csr_array(G)
    ptr = G.indptr.astype(np.int64)
    cols = G.indices.astype(np.int64)
    P = active_set.pattern(ptr, cols, G.shape[1])
    tree = python_entry(nested_dissection.assembly_tree)
    return P, tree(ptr, cols, P.tptr, P.trow), G.data.astype(float)
