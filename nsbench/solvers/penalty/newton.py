"""Newton's iteration with one Jacobian per step, for the stages of diffrax's implicit Runge-Kutta
methods.

diffrax.VeryChord is not used: it factorises the quadratures too, measures increments of slopes
(size k) instead of what they change in the state (19 times the steps on three_discs at k = 3840),
and takes rounding in them for divergence (hex at k = 1631 failed at every step size). Loaded only
with nsbench.solvers.penalty.integrator.
"""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix

# error left in a stage, in units of the step's tolerance (Hairer & Wanner II, IV.8: 1e-1 to 1e-2)
KAPPA = 1e-2


class Chord(optimistix.AbstractRootFinder):
    """Solves F(y) = y - f(t, z + d h y) = 0 for the slope y of a stage; z holds n states, then
    quadratures.

    Quadratures drive nothing: the matrix is [[A, 0], [C, I]] and only A (n, n) is factorised: with
    the 435 pairs of 30 discs 60 columns, not 555. Increments are measured as what they change in z,
    in units of the tolerance.
    """

    n: int = eqx.field(static=True)
    rtol: jax.Array
    atol: jax.Array
    norm: Callable = eqx.field(static=True)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        if "init_state" in options:
            return options["init_state"]
        _, along = jax.linearize(lambda v: fn(v, args)[0], y)
        columns = jax.vmap(along, out_axes=1)(jnp.eye(self.n, y.size))
        far = jnp.array(jnp.inf)
        return (
            *jax.scipy.linalg.lu_factor(columns[: self.n]),
            columns[self.n :],
            far,
            far,
            jnp.array(0),
        )

    def step(self, fn, y, args, options, state, tags):
        lu, pivots, C, size, _, count = state
        _, diagonal, _, prod, _, z, _, dt = args  # as diffrax passes them to a root finder
        F, aux = fn(y, args)
        head = jax.scipy.linalg.lu_solve((lu, pivots), F[: self.n])
        d = jnp.concatenate([head, F[self.n :] - C @ head])
        new = self.norm(diagonal * prod(d, dt) / (self.atol + self.rtol * jnp.abs(z)))
        return y - d, (lu, pivots, C, new, size, count + 1), aux

    def terminate(self, fn, y, args, options, state, tags):
        """Done when the increments still to come are below KAPPA; failed when they grow and are not
        rounding."""
        *_, size, before, count = state  # both infinite until there are increments
        rate = size / before
        done = (size < 0.1 * KAPPA) | (
            (count > 1) & (rate < 1.0) & (size * rate < KAPPA * (1.0 - rate))
        )
        failed = ~done & (((count > 0) & ~jnp.isfinite(size)) | ((count > 1) & (rate > 2.0)))
        result = optimistix.RESULTS.where(
            failed, optimistix.RESULTS.nonlinear_divergence, optimistix.RESULTS.successful
        )
        return done | failed, result

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, aux, {}
