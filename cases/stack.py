"""Stack: discs piled exactly above each other on a floor under gravity; nothing must move.

    x_i' = (0, -1) + contact forces,   g_i = y_i - 1 >= 0 (floor),   g_ij = |x_i - x_j| - 2 >= 0

Exact: rest. In one column of n discs the floor carries lam = n (under the lowest) and the contact below disc i
carries the n - i discs from i upwards (counted from 0): the state and the impulses lam t are known for all time.

What it is for: the "jittering and collapsing stack". One sweep passes a load on by one disc per step or so; the
load on the floor is reached after about 1.8 n^2 steps, and by then the column has sunk by h n (n - 1) / 2 (190 h for
n = 20): order one, with a large constant. A column is unstable physically: x_i are equal exactly, so only a method that
moves a disc sideways by itself can topple it. `columns` > 1 puts touching columns between two walls; these rows can
be stressed against the walls at will, so the impulses are not unique there.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity, Distance

SUITES = {"smoke": [{"n": 5}], "standard": [{"n": 20}], "full": [{"n": 6, "columns": 6}]}


def floor_and_walls(count, columns):
    """y_i >= 1 for every disc; with several columns also x_i >= 1 and x_i <= 2 columns - 1."""
    from scipy.sparse import csr_array, vstack
    i = np.arange(count)
    def rows(axis, value):
        return csr_array((np.full(count, value), (i, 2 * i + axis)), shape=(count, 2 * count))
    if columns == 1:
        return Affine(rows(1, 1.0), np.full(count, -1.0))
    return Affine(vstack((rows(1, 1.0), rows(0, 1.0), rows(0, -1.0)), format="csr"),
                  np.repeat([-1.0, -1.0, 2.0 * columns - 1.0], count))


def make(n: int = 20, columns: int = 1) -> Case:
    """n: discs above each other; columns: how many such columns stand between the walls (one needs no walls)."""
    if n < 1 or columns < 1:
        raise ValueError(f"n is {n!r}, columns {columns!r}; at least 1")
    col, row = np.divmod(np.arange(n * columns), n)
    x0 = np.stack((2.0 * col + 1.0, 2.0 * row + 1.0), axis=1).ravel()
    weight = np.tile([0.0, -1.0], n * columns)
    loads = n - np.arange(float(n))

    def drift(xp):
        def f(t, x):
            return weight + 0.0 * x
        return f

    def exact(t):
        return np.tile(x0, (len(t), 1))

    def exact_impulse(t):
        return t[:, None] * loads

    unique = columns == 1
    return Case(
        name="stack",
        problem=Complementarity(drift, (floor_and_walls(n * columns, columns), Distance(d=2.0))),
        x0=x0,
        t=np.linspace(0.0, 2.0, 21),
        exact=exact, exact_impulse=exact_impulse if unique else None, exact_events=(),
        contacts=((0, 0), *((1, i, i + 1) for i in range(n - 1))) if unique else None,
        substeps=min(40, max(8, n * n // 10)), also=("pbd[order=reverse]",), radius=1.0,
        tags=("seed",) if unique else ("seed", "redundant"),
    )
