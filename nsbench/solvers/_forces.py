"""Penalty forces of the constraint families, and the smoothed Filippov field, as JAX functions.

A right-hand side here takes (t, z, k) where z is the state followed by its quadratures: the impulses and, for
constraints, the reaction. Integrated by the same Runge-Kutta weights, x - x0 = integral of f + reaction and
reaction = sum of impulse * grad g (constant gradients) hold to rounding, whatever the step.
"""
from __future__ import annotations

import numpy as np

from nsbench.compile import jax_function
from nsbench.problem import Affine, Complementarity, Distance, Filippov, Smooth


def constraint_ids(problem, n: int) -> list[tuple]:
    """Contact ids in the stated order, all pairs i < j listed; surfaces (0, i) for a Filippov system."""
    if isinstance(problem, Filippov):
        return [(0, i) for i in range(_surfaces(problem, n))]
    ids = []
    for k, c in enumerate(problem.constraints):
        if isinstance(c, Distance):
            ids += [(k, int(i), int(j)) for i, j in zip(*_pairs(c, n), strict=True)]
        else:
            ids += [(k, i) for i in range(_rows(c, n))]
    return ids


def count(problem, n: int) -> int:
    """How many constraints there are, without listing pairs."""
    if isinstance(problem, Filippov):
        return _surfaces(problem, n)
    total = 0
    for c in problem.constraints:
        if not isinstance(c, Distance):
            total += _rows(c, n)
        elif c.pairs is not None:
            total += len(c.pairs)
        else:
            particles = c.particles(n)
            total += particles * (particles - 1) // 2 if c.anchors is None else particles * _anchors(c)
    return total


def right_hand_side(problem, n: int):
    """(t, z, k) -> dz/dt. Complementarity: z = (x, m impulses, n reactions); Filippov: z = (x, d weights)."""
    return _filippov(problem, n) if isinstance(problem, Filippov) else _penalty(problem, n)


def _penalty(problem: Complementarity, n: int):
    """x' = f + sum lam grad g, impulse' = lam, reaction' = sum lam grad g, lam = k max(-g, 0)."""
    import jax.numpy as jnp
    f = jax_function(problem.drift)
    make = {Affine: _affine, Distance: _distance, Smooth: _smooth}
    families = [make[type(c)](c, n) for c in problem.constraints]

    def rhs(t, z, k):
        x = z[:n]
        parts = [family(t, x, k) for family in families]
        force = sum(p[1] for p in parts)
        return jnp.concatenate([f(t, x) + force, *(p[0] for p in parts), force])
    return rhs


def _filippov(problem: Filippov, n: int):
    """x' = field(t, x, s), weight' = (1 + s) / 2, s = clip(k c, -1, 1): a boundary layer of half-width 1/k.

    The clipped sign, and not tanh: outside the layer it is exact, and at an exit from sliding the layer is left at
    c = 1/k, where tanh (s -> 1 only as c -> infinity) lags by log(k)/k and spoils the order in 1/k.
    """
    import jax.numpy as jnp
    field, switch = jax_function(problem.field), jax_function(problem.switch)

    def rhs(t, z, k):
        x = z[:n]
        s = jnp.clip(k * switch(t, x), -1.0, 1.0)
        return jnp.concatenate([field(t, x, s), 0.5 * (1.0 + s)])
    return rhs


def _surfaces(problem: Filippov, n: int) -> int:
    return problem.d if problem.d is not None else len(problem.switch(np)(0.0, np.full(n, 0.37)))


def _rows(c, n: int) -> int:
    return c.shape[0] if isinstance(c, Affine) else len(c.g(np)(0.0, np.full(n, 0.37)))


def _anchors(c: Distance) -> int:
    return len(np.asarray(c.anchors(np)(0.0) if c.moving else c.anchors))


def _pairs(c: Distance, n: int):
    """First and second indices of all pairs of a family."""
    if c.pairs is not None:
        return c.pairs.T
    if c.anchors is None:
        return np.triu_indices(c.particles(n), 1)
    i, j = np.indices((c.particles(n), _anchors(c)))
    return i.ravel(), j.ravel()


def _moving(value, moving: bool):
    """A curve t -> array in JAX."""
    return jax_function(value) if moving else lambda t: value


def _affine(c: Affine, n: int):
    import jax.numpy as jnp
    m = c.shape[0]
    b = _moving(c.b, c.moving)
    rows = np.repeat(np.arange(m), np.diff(c.indptr))

    def push(t, x, k):
        g = jnp.zeros(m).at[rows].add(c.data * x[c.indices]) + b(t)
        lam = k * jnp.maximum(-g, 0.0)
        return lam, jnp.zeros(n).at[c.indices].add(c.data * lam[rows])
    return push


def _distance(c: Distance, n: int):
    """Coincident points are parted along the first axis, as in nsbench.contacts; the slope of the length is then 0."""
    import jax.numpy as jnp
    N, end = c.particles(n), c.start + c.particles(n) * c.dim
    i, j = _pairs(c, n)
    d = c.d if c.radii is None else np.broadcast_to(c.radii, N)[i] + np.broadcast_to(c.radii, N)[j]
    first = np.eye(c.dim)[0]
    anchors = None if c.anchors is None else _moving(c.anchors, c.moving)

    def push(t, x, k):
        p = x[c.start:end].reshape(N, c.dim)
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
        return lam, jnp.zeros(n).at[c.start:end].set(total.ravel()) if N * c.dim < n else total.ravel()
    return push


def _smooth(c: Smooth, n: int):
    """The gradient is only needed times lam: a reverse-mode product, unless the family brings its own."""
    import jax
    import jax.numpy as jnp
    g = jax_function(c.g)
    gradient = jax_function(c.gradient) if c.gradient else None

    def push(t, x, k):
        value, back = jax.vjp(lambda y: g(t, y), x)
        lam = k * jnp.maximum(-value, 0.0)
        return lam, jnp.asarray(gradient(t, x)).T @ lam if gradient else back(lam)[0]
    return push
