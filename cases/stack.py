"""Stack: discs piled up on a floor under gravity, in a column or between walls; nothing must move.

    x_i' = (0, -1) + contact forces,   g_i = y_i - 1 >= 0 (floor),   g_ij = |x_i - x_j| - 2 >= 0

Exact: rest. In one column of n discs the floor carries lam = n (under the lowest) and the contact below disc i
carries the n - i discs from i upwards (counted from 0): the state and the impulses lam t are known for all time.

What it is for: the "jittering and collapsing stack". One sweep passes a load on by one disc per step or so; the
load on the floor is reached after about 1.8 n^2 steps, and by then the column has sunk by h n (n - 1) / 2 (190 h for
n = 20): order one, with a large constant. A column is unstable physically: x_i are equal exactly, so only a method that
moves a disc sideways by itself can topple it. The figure for all of them is the drift per unit time.

Between two walls, `columns` discs on the floor, touching: shape = "square" stands n such rows on each other, "hex" lays
n rows of columns and columns - 1 discs in turn into the gaps below, "pile" rows of one less each, up to n = columns of
them. All of these rest: the discs in a gap are carried by two below, and what pushes sideways goes into the walls. Each
row can be stressed against the walls at will, so the impulses are not unique there; the reaction is the weight.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity, Distance

SUITES = {"smoke": [{"n": 5}], "standard": [{"n": 20}],
          "full": [{"n": 6, "columns": 6}, {"n": 5, "columns": 5, "shape": "pile"}, {"n": 6, "columns": 6, "shape": "hex"}]}
SHAPES = ("square", "pile", "hex")


def places(n, columns, shape):
    """Centres (discs, 2): disc by disc of a column, or row by row from below."""
    if shape == "square":
        col, row = np.divmod(np.arange(n * columns), n)
        return np.stack((2.0 * col + 1.0, 2.0 * row + 1.0), axis=1)
    out = []
    for row in range(n):
        less = row if shape == "pile" else row % 2          # discs fewer than on the floor, and so far to the right
        out += [(1.0 + less + 2.0 * k, 1.0 + 3.0 ** 0.5 * row) for k in range(columns - less)]
    return np.array(out)


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


def make(n: int = 20, columns: int = 1, shape: str = "square") -> Case:
    """n: rows above each other; columns: discs in the lowest one (one needs no walls); shape: how the rows are laid."""
    if n < 1 or columns < 1:
        raise ValueError(f"n is {n!r}, columns {columns!r}; at least 1")
    if shape not in SHAPES:
        raise ValueError(f"shape is {shape!r}; one of {', '.join(SHAPES)}")
    if shape != "square" and (columns < 2 or (shape == "pile" and n > columns)):
        raise ValueError(f"shape is {shape!r}: at least 2 columns are needed, and no more rows in a pile; "
                         f"n is {n!r}, columns {columns!r}")
    x0 = places(n, columns, shape).ravel()
    weight = np.tile([0.0, -1.0], len(x0) // 2)
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
        problem=Complementarity(drift, (floor_and_walls(len(x0) // 2, columns), Distance(d=2.0))),
        x0=x0,
        t=np.linspace(0.0, 2.0, 21),
        exact=exact, exact_impulse=exact_impulse if unique else None, exact_events=(),
        contacts=((0, 0), *((1, i, i + 1) for i in range(n - 1))) if unique else None,
        substeps=min(40, max(8, n * n // 10)), also=("pbd[order=reverse]",), radius=1.0,
        tags=("seed", "constant_force") if unique else ("seed", "constant_force", "redundant"),
    )
