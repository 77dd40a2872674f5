"""Penalty forces of the constraint families, and the smoothed Filippov field, as JAX functions.

A right-hand side here takes (t, z, k) where z is the state followed by its quadratures: the
impulses and, for constraints, the reaction. Integrated by the same Runge-Kutta weights, x - x0 =
integral of f + reaction and reaction = sum of impulse * grad g (constant gradients) hold to
rounding, whatever the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.factories import as_jax, as_numpy
from nsbench.dynamics.filippov.modes import count_surfaces, is_multilinear, sign_patterns
from nsbench.problem import Affine, Complementarity, Distance, Filippov, Smooth

if TYPE_CHECKING:
    import jax

# entries up to which rows are a dense matrix: its zeros cost less than a scatter's calls
DENSE = 4096


def constraint_ids(problem: Complementarity | Filippov, n: int) -> list[tuple]:
    """List the contact ids in the order of the problem, with all pairs i < j of hard particles.

    Of a Filippov system: the surfaces (0, i).
    """
    if isinstance(problem, Filippov):
        return [(0, i) for i in range(count_surfaces(problem, n))]
    return [name for k, c in enumerate(problem.constraints) for name in _ids(k, c, n)]


def _ids(k, c, n):
    """List the contact ids of family c, the k-th of the problem."""
    if isinstance(c, Distance):
        return [(k, i, j) for i, j in zip(*(a.tolist() for a in _pairs(c, n)), strict=True)]
    return [(k, i) for i in range(_rows(c, n))]


def count(problem: Complementarity | Filippov, n: int) -> int:
    """Count the constraints of a problem, without listing pairs.

    Of a Filippov system: its surfaces.
    """
    if isinstance(problem, Filippov):
        return count_surfaces(problem, n)
    total = 0
    for c in problem.constraints:
        if not isinstance(c, Distance):
            total += _rows(c, n)
        elif c.pairs is not None:
            total += len(c.pairs)
        else:
            particles = c.particles(n)
            total += (
                particles * (particles - 1) // 2 if c.anchors is None else particles * _anchors(c)
            )
    return total


def layout(
    problem: Complementarity | Filippov, n: int, style: str, capacity: tuple[int, ...] = ()
) -> tuple[list, np.ndarray, int, dict]:
    """Lay out the quadratures of `slopes`.

    style, capacity: as for `slopes`. Returns (ids, columns, size, offsets): ids of the constraints
    that have a quadrature of their own, their columns, the number of all quadratures, and {family:
    first column} of the families that use neighbour lists.
    """
    if isinstance(problem, Filippov):
        ids = constraint_ids(problem, n)
        return ids, np.arange(len(ids)), len(ids), {}
    ids = []
    columns = []
    offsets = {}
    size = 0
    for k, c in enumerate(problem.constraints):
        if _uses_lists(c, style):
            offsets[k] = size
            size += c.particles(n) * capacity[len(offsets) - 1]
            continue
        mine = _ids(k, c, n)
        ids += mine
        columns += range(size, size + len(mine))
        size += len(mine)
    return ids, np.array(columns, np.int64), size + n, offsets


def _uses_lists(c, style):
    """Are the pairs of this family taken from neighbour lists?"""
    return style == "near" and isinstance(c, Distance) and c.all_pairs


@dataclass(frozen=True)
class Slopes:
    """Right-hand side of the state and of its quadratures.

    f: (t, x, k, lists) -> (x', quadratures'); size: number of the quadratures.
    """

    f: Callable
    size: int


def slopes(
    problem: Complementarity | Filippov,
    n: int,
    style: str = "pairs",
    capacity: tuple[int, ...] = (),
) -> Slopes:
    """Build the right-hand side of the penalised problem, for the state and its quadratures.

    Quadratures with constraints: m impulses, then n reactions; Filippov: d weights. k is the
    stiffness.

    style: how the pairs of hard particles are visited. "pairs": each once; "near": each twice,
    those in lists = (neighbours (N, capacity) of each such family), where a particle's own number
    fills up its row.
    """
    size = layout(problem, n, style, capacity)[2]
    if isinstance(problem, Filippov):
        return Slopes(_filippov(problem, n), size)
    import jax.numpy as jnp

    f = as_jax(problem.drift)
    families = []
    place = 0
    for c in problem.constraints:
        if _uses_lists(c, style):
            families.append(_near(c, n, place))
            place += 1
        else:
            families.append({Affine: _affine, Distance: _distance, Smooth: _smooth}[type(c)](c, n))

    def penalised(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        parts = [family(t, x, k, lists) for family in families]
        force = sum(p[1] for p in parts)
        return f(t, x) + force, jnp.concatenate([*(p[0] for p in parts), force])

    return Slopes(penalised, size)


def right_hand_side(problem: Complementarity | Filippov, n: int) -> Callable:
    """Build (t, z, k) -> dz/dt of the state and its quadratures in one vector.

    Complementarity: z = (x, m impulses, n reactions); Filippov: z = (x, d weights).
    """
    import jax.numpy as jnp

    f = slopes(problem, n).f
    return lambda t, z, k: jnp.concatenate(f(t, z[:n], k, ()))


def _filippov(problem: Filippov, n: int):
    """Smooth a Filippov field over a boundary layer of half-width 1/k.

        x' = field(t, x, s),   weight' = (1 + s) / 2,   s = clip(k c, -1, 1)

    The sign is clipped, and not tanh: outside the layer it is exact, and at an exit from sliding
    the layer is left at c = 1/k, where tanh (s -> 1 only as c -> infinity) lags by log(k)/k and
    spoils the order in 1/k. Between the modes a Filippov system is multilinear in s: a field that
    is not is evaluated at the corners.
    """
    import jax.numpy as jnp

    field = as_jax(problem.field)
    switch = as_jax(problem.switch)
    if not is_multilinear(problem, n):
        field = _blended(field, count_surfaces(problem, n))

    def smoothed(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        s = jnp.clip(k * switch(t, x), -1.0, 1.0)
        return field(t, x, s), 0.5 * (1.0 + s)

    return smoothed


def _blended(field: Callable, d: int) -> Callable:
    """Build the field multilinear in s with the same values at the corners of the box of signs."""
    import jax
    import jax.numpy as jnp

    signs = jnp.asarray(sign_patterns(d))

    def blended(t: float, x: jax.Array, s: jax.Array) -> jax.Array:
        return jnp.prod(0.5 * (1.0 + signs * s), axis=1) @ jax.vmap(lambda q: field(t, x, q))(signs)

    return blended


def _rows(c, n: int) -> int:
    """Count the rows of an affine or smooth family."""
    return c.shape[0] if isinstance(c, Affine) else len(as_numpy(c.g)(0.0, np.full(n, 0.37)))


def _anchors(c: Distance) -> int:
    """Count the anchors of a distance family."""
    return len(np.asarray(as_numpy(c.anchors)(0.0) if c.moving else c.anchors))


def _pairs(c: Distance, n: int):
    """Return the first and second indices of all pairs of a family."""
    if c.pairs is not None:
        return c.pairs.T
    if c.anchors is None:
        return np.triu_indices(c.particles(n), 1)
    i, j = np.indices((c.particles(n), _anchors(c)))
    return i.ravel(), j.ravel()


def _moving(value, moving: bool):
    """Return the curve t -> array in JAX; a constant one where nothing moves."""
    return as_jax(value) if moving else lambda t: value


def _affine(c: Affine, n: int):
    """Build the penalty force of affine rows, lam = k max(-(A x + b), 0).

    A is dense for up to DENSE entries, else sparse.
    """
    import jax.numpy as jnp

    m = c.shape[0]
    b = _moving(c.b, c.moving)
    rows = np.repeat(np.arange(m), np.diff(c.indptr))
    if m * n <= DENSE:
        A = np.zeros((m, n))
        np.add.at(A, (rows, c.indices), c.data)

        def push(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
            lam = k * jnp.maximum(-((A * x).sum(1) + b(t)), 0.0)
            return lam, (A * lam[:, None]).sum(0)

        return push

    def push(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        g = jnp.zeros(m).at[rows].add(c.data * x[c.indices]) + b(t)
        lam = k * jnp.maximum(-g, 0.0)
        return lam, jnp.zeros(n).at[c.indices].add(c.data * lam[rows])

    return push


def _distance(c: Distance, n: int):
    """Build the penalty force of a distance family, pair by pair.

    Coincident points are separated along the first axis, as in
    nsbench.dynamics.contacts.constraint_set; the slope of the length is then 0.
    """
    import jax.numpy as jnp

    N = c.particles(n)
    if c.all_pairs and c.sign == 1 and N * N <= DENSE:
        return _square(c, n, N)
    i, j = _pairs(c, n)
    d = c.d if c.radii is None else np.broadcast_to(c.radii, N)[i] + np.broadcast_to(c.radii, N)[j]
    first = np.eye(c.dim)[0]
    anchors = None if c.anchors is None else _moving(c.anchors, c.moving)

    def push(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        p = _positions(c, n, x)
        diff = p[i] - (p[j] if anchors is None else jnp.asarray(anchors(t))[j])
        square = (diff * diff).sum(1)
        apart = square > 0.0
        length = jnp.sqrt(jnp.where(apart, square, 1.0))
        unit = jnp.where(apart[:, None], diff / length[:, None], first)
        lam = k * jnp.maximum(-c.sign * (jnp.where(apart, length, 0.0) - d), 0.0)
        force = c.sign * lam[:, None] * unit
        total = jnp.zeros_like(p).at[i].add(force)
        if anchors is None:
            total = total.at[j].add(-force)
        return lam, _spread(c, n, total)

    return push


def _square(c: Distance, n: int, N: int):
    """Build the penalty force of all pairs of a few hard particles as a table (N, N).

    Each pair is computed twice, which takes less time than to gather and scatter it once.
    """
    import jax.numpy as jnp

    r = np.broadcast_to(c.radii if c.radii is not None else c.d / 2, N)
    reach = r[:, None] + r
    number = np.arange(N)
    own = np.eye(N, dtype=bool)
    way = np.sign(number - number[:, None]).astype(float)
    i, j = _pairs(c, n)

    def push(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        p = _positions(c, n, x)
        parts = [p[:, a][:, None] - p[:, a] for a in range(c.dim)]
        square = sum(q * q for q in parts)
        apart = square > 0.0
        length = jnp.sqrt(jnp.where(apart, square, 1.0))
        lam = jnp.where(own, 0.0, k * jnp.maximum(reach - jnp.where(apart, length, 0.0), 0.0))
        w = lam / length
        along = jnp.where(apart, parts[0] * w, way * lam)
        return lam[i, j], _spread(
            c, n, jnp.stack([along.sum(1), *((q * w).sum(1) for q in parts[1:])], axis=1)
        )

    return push


def _positions(c, n, x):
    """Return the coordinates (N, dim) of a family's particles."""
    N = c.particles(n)
    return x[c.start : c.start + N * c.dim].reshape(N, c.dim)


def _spread(c, n, total):
    """Embed the forces (N, dim) on a family's particles in a vector (n,)."""
    import jax.numpy as jnp

    return (
        total.ravel()
        if total.size == n
        else jnp.zeros(n).at[c.start : c.start + total.size].set(total.ravel())
    )


def _near(c: Distance, n: int, place: int):
    """Build the penalty force of the pairs of lists[place] (N, capacity).

    A row holds the neighbours of a particle, filled up with the particle's own number.
    """
    import jax.numpy as jnp

    N = c.particles(n)
    r = np.array(np.broadcast_to(c.radii if c.radii is not None else c.d / 2, N))
    number = np.arange(N)[:, None]

    def push(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        nb = lists[place]
        p = _positions(c, n, x)
        parts = [p[:, a][:, None] - p[:, a][nb] for a in range(c.dim)]
        square = sum(q * q for q in parts)
        apart = square > 0.0
        length = jnp.sqrt(jnp.where(apart, square, 1.0))
        depth = r[:, None] + jnp.asarray(r)[nb] - jnp.where(apart, length, 0.0)
        lam = jnp.where(nb == number, 0.0, k * jnp.maximum(depth, 0.0))
        w = lam / length
        along = jnp.where(
            apart, parts[0] * w, jnp.where(nb > number, lam, -lam)
        )  # coincident: as in _distance
        return lam.ravel(), _spread(
            c, n, jnp.stack([along.sum(1), *((q * w).sum(1) for q in parts[1:])], axis=1)
        )

    return push


def _smooth(c: Smooth, n: int):
    """Build the penalty force of a smooth family.

    The gradient is only needed times lam: a reverse-mode product, unless the family brings its own
    gradient.
    """
    import jax
    import jax.numpy as jnp

    g = as_jax(c.g)
    gradient = as_jax(c.gradient) if c.gradient else None

    def push(t: float, x: jax.Array, k: float, lists: tuple) -> tuple[jax.Array, jax.Array]:
        value, back = jax.vjp(lambda y: g(t, y), x)
        lam = k * jnp.maximum(-value, 0.0)
        return lam, jnp.asarray(gradient(t, x)).T @ lam if gradient else back(lam)[0]

    return push
