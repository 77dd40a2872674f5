"""Integrate adaptively to given sample times with the Runge-Kutta methods of diffrax.

diffrax.diffeqsolve is not used: its loop costs 3 times as long to compile as the one here (8 times
to trace), reads samples off an interpolant, and reports neither why a step was refused nor when no
step can succeed any more.
Explicit methods take their coefficients from diffrax and run through a loop over the stages that
keeps, of the quadratures, two sums. Stages written out one by one take 1.3 to 1.8 times as long to
compile and, on all but chains of links, as long or longer to run: the compiler computes stages
again for each of their sums.
Stages of implicit methods are solved by a chord Newton iteration with one Jacobian per step.
diffrax.VeryChord is not used: it factorises the quadratures too, measures increments of slopes
(size k) instead of what they change in the state (19 times the steps on three_discs at k = 3840),
and takes rounding in them for divergence (hex at k = 1631 failed at every step size).
Loaded only when a penalty program is traced, not when it is found in the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jax import lax

if TYPE_CHECKING:
    from nsbench.solvers.penalty.forces import Slopes

EXPLICIT = {"bosh3": diffrax.Bosh3, "tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}
IMPLICIT = {"kvaerno3": diffrax.Kvaerno3, "kvaerno5": diffrax.Kvaerno5}
NEVER, TOO_LARGE, NOT_FINITE, NEWTON = range(4)  # why the last step was refused, if it was
# error left in a stage, in units of the step's tolerance (Hairer & Wanner II, IV.8: 1e-1 to 1e-2)
KAPPA = 1e-2
REST = 0.6  # of the certified travel: an accepted step that ends beyond it ends the segment


class Chord(optimistix.AbstractRootFinder):
    """Solve F(y) = y - f(t, z + d h y) = 0 for the slope y of a stage by a chord iteration.

    z holds n states, then quadratures. Quadratures drive nothing: the matrix is [[A, 0], [C, I]]
    and only A (n, n) is factorised: with the 435 pairs of 30 discs 60 columns, not 555. Increments
    are measured as what they change in z, in units of the tolerance.
    """

    n: int = eqx.field(static=True)
    rtol: jax.Array
    atol: jax.Array
    norm: Callable = eqx.field(static=True)

    def init(
        self,
        fn: Callable,
        y: jax.Array,
        args: tuple,
        options: dict,
        f_struct: object,
        aux_struct: object,
        tags: frozenset,
    ) -> tuple:
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

    def step(
        self, fn: Callable, y: jax.Array, args: tuple, options: dict, state: tuple, tags: frozenset
    ) -> tuple[jax.Array, tuple, object]:
        lu, pivots, C, size, _, count = state
        _, diagonal, _, prod, _, z, _, dt = args  # as diffrax passes them to a root finder
        F, aux = fn(y, args)
        head = jax.scipy.linalg.lu_solve((lu, pivots), F[: self.n])
        d = jnp.concatenate([head, F[self.n :] - C @ head])
        new = self.norm(diagonal * prod(d, dt) / (self.atol + self.rtol * jnp.abs(z)))
        return y - d, (lu, pivots, C, new, size, count + 1), aux

    def terminate(
        self, fn: Callable, y: jax.Array, args: tuple, options: dict, state: tuple, tags: frozenset
    ) -> tuple[jax.Array, optimistix.RESULTS]:
        """Stop when the increments still to come are below KAPPA; fail when they grow.

        Increments that are rounding may grow.
        """
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

    def postprocess(
        self,
        fn: Callable,
        y: jax.Array,
        aux: object,
        args: tuple,
        options: dict,
        state: tuple,
        tags: frozenset,
        result: optimistix.RESULTS,
    ) -> tuple[jax.Array, object, dict]:
        return y, aux, {}


def _largest(z):
    return jnp.max(jnp.abs(z))


def _stepper(slopes, method: str, n: int, rtol, atol):
    """step(t, end, z, args, stage) -> (z1, error, stage, solved), and the first stage (t, z, args)
    -> stage."""
    if method in EXPLICIT:
        return _looped(slopes.f, EXPLICIT[method].tableau, n)
    term = diffrax.ODETerm(lambda t, z, args: jnp.concatenate(slopes.f(t, z[:n], *args)))
    solver = IMPLICIT[method](scan_kind="lax", root_finder=Chord(n, rtol, atol, _largest))

    def step(
        t: jax.Array, end: jax.Array, z: jax.Array, args: tuple, stage: object
    ) -> tuple[jax.Array, jax.Array, object, jax.Array]:
        z1, error, _, stage, result = solver.step(term, t, end, z, args, stage, False)
        return z1, error, stage, result == diffrax.RESULTS.successful

    return step, lambda t, h, z, args: solver.init(term, t, t + h, z, args)


def _looped(f, tableau, n):
    """An explicit method whose last stage is the first of the next step. Quadratures drive nothing:
    the stages need the state alone, and of the quadratures no more than two sums are kept."""
    m = len(tableau.c)
    lower = np.zeros((m, m + 1))
    for i, a in enumerate(tableau.a_lower):
        lower[i, : len(a)] = a
    lower, nodes, sol, err = (
        jnp.asarray(np.asarray(a, float))
        for a in (lower, tableau.c, tableau.b_sol, tableau.b_error)
    )

    def step(
        t: jax.Array, end: jax.Array, z: jax.Array, args: tuple, stage: jax.Array
    ) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        h = end - t
        x = z[:n]

        def body(i: jax.Array, c: tuple) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
            slopes, total, wrong, _ = c
            at = jnp.where(nodes[i] == 1.0, end, t + nodes[i] * h)
            k = jnp.concatenate(f(at, x + h * (lower[i][:, None] * slopes).sum(0), *args))
            return slopes.at[i + 1].set(k[:n]), total + sol[i + 1] * k, wrong + err[i + 1] * k, k

        first = jnp.zeros((m + 1, n)).at[0].set(stage[:n])
        _, total, wrong, last = lax.fori_loop(
            0, m, body, (first, sol[0] * stage, err[0] * stage, stage)
        )
        return z + h * total, h * wrong, last, jnp.array(True)

    return step, lambda t, h, z, args: jnp.concatenate(f(t, z[:n], *args))


def stages(method: str) -> int:
    """Right-hand sides per accepted or refused step of an explicit method (first same as last
    counted once)."""
    tableau = EXPLICIT[method].tableau
    return tableau.num_stages - (1 if tableau.fsal else 0)


@dataclass(frozen=True)
class _TimeLoop:
    """The loop over steps of one run, as condition and body of lax.while_loop.

    step_of(t, end, z, args, stage): a step; ts (K,): sample times; near: () or neighbour lists; n:
    number of states of z; parts: equal parts of ts after each of which z is stored.
    """

    step_of: Callable
    controller: diffrax.PIDController
    order: object
    args: tuple
    ts: jax.Array
    max_steps: object
    near: tuple
    n: int
    parts: int

    def goes_on(self, c: dict) -> jax.Array:
        """Is there a sample to reach, a step left, and a step long enough to change the time?"""
        # 8 spacings of t; 0.9 of less than 5 rounds to no less
        resolved = c["t"] + 0.06 * c["h"] > c["t"]
        on = (
            (c["i"] < self.ts.shape[0]) & (c["accepted"] + c["refused"] < self.max_steps) & resolved
        )
        return on & ~c["far"] if self.near else on

    def step(self, c: dict) -> dict:
        """Take one step, cut to end at the next sample, and accept or refuse it."""
        ts = self.ts
        near = self.near
        t = c["t"]
        h = c["h"]
        z = c["z"]
        target = ts[c["i"]]
        cut = t + 1.001 * h >= target
        end = jnp.where(cut, target, t + h)
        z1, error, stage, solved = self.step_of(t, end, z, self.args, c["stage"])
        finite = jnp.isfinite(z1).all()
        error = jnp.where(solved & finite & jnp.isfinite(error).all(), error, jnp.inf)
        keep, _, end1, _, control, _ = self.controller.adapt_step_size(
            t, end, z, z1, self.args, error, self.order, c["control"]
        )
        t1 = jnp.where(keep, end, t)
        h1 = jnp.where(keep & cut, jnp.maximum(end1 - t1, h), end1 - t1)
        cause = jnp.where(
            keep, NEVER, jnp.where(finite, jnp.where(solved, TOO_LARGE, NEWTON), NOT_FINITE)
        )
        choose = lambda new, old: jax.tree_util.tree_map(
            lambda a, b: jnp.where(keep, a, b), new, old
        )
        arrived = keep & cut
        samples = c["samples"].at[c["i"]].set(jnp.where(arrived, z1, jnp.nan))
        way = c["way"]
        if self.parts:
            last = self.parts - 1
            part = jnp.clip((t1 - ts[0]) / (ts[-1] - ts[0]) * self.parts, 0, last).astype(int)
            way = way.at[part].set(jnp.where(keep, jnp.append(t1, z1), way[part]))
        far = (_travel(z1[: self.n], near) > REST * near[2]) & keep if near else False
        return dict(
            i=c["i"] + arrived,
            t=t1,
            h=h1,
            z=choose(z1, z),
            stage=choose(stage, c["stage"]),
            control=control,
            samples=samples,
            accepted=c["accepted"] + keep,
            refused=c["refused"] + ~keep,
            cause=cause,
            longest=jnp.maximum(c["longest"], t1 - t),
            far=far,
            way=way,
            last=jnp.where(keep, end - t, c["last"]),
        )


def integrator(slopes: Slopes, method: str, n: int, parts: int = 0) -> Callable:
    """Return run(z0, i, t, h, ts, k, rtol, atol, max_steps, near) -> dict of samples and counts.

    It goes from z0 at time t to ts[i] and on, with a first step h; atol (size,). Errors are
    controlled in the maximum norm, so that many idle quadratures do not dilute one active. Steps
    are cut to end at samples (the uncut size is kept). Steps too short for floating point and
    max_steps end the loop early: "i" is then less than K, later samples are NaN.
    near: () or (lists, base, reach) where lists hold all that can touch while no coordinate is
    further than `reach` from base (n,). Right-hand sides beyond that are NaN, so that a step that
    asks for one is refused; the loop ends after a step beyond REST of it ("far"), or when such a
    step was refused ("cause" NOT_FINITE).
    samples (K, size); way (parts, 1 + size): time and z after the last step in each of so many
    equal parts of ts, NaN where none ended.
    """

    def run(
        z0: jax.Array,
        i: int,
        t: float,
        h: float,
        ts: jax.Array,
        k: float,
        rtol: float,
        atol: jax.Array,
        max_steps: int,
        near: tuple,
    ) -> dict[str, jax.Array]:
        watched, args = _watch(slopes, n, k, near)
        step_of, first = _stepper(watched, method, n, rtol, atol)
        # proportional control where stability limits the step: a third of the refusals of the plain
        # controller
        proportional, integral = (0.3, 0.4) if method in EXPLICIT else (0.0, 1.0)
        controller = diffrax.PIDController(
            rtol=rtol, atol=atol, pcoeff=proportional, icoeff=integral, norm=_largest
        )
        term = diffrax.ODETerm(lambda t, z, args: z)  # only its type is used
        named = EXPLICIT[method]() if method in EXPLICIT else IMPLICIT[method]()
        order = named.error_order(term)
        _, control = controller.init(term, t, t + h, z0, h, args, named.func, order)
        start = dict(
            i=i,
            t=t,
            h=h,
            z=z0,
            stage=first(t, h, z0, args),
            control=control,
            samples=jnp.full((ts.shape[0], z0.shape[0]), jnp.nan).at[i - 1].set(z0),
            accepted=0,
            refused=0,
            cause=NEVER,
            longest=0.0,
            last=0.0,
            far=False,
            way=jnp.full((parts, 1 + z0.shape[0]), jnp.nan),
        )
        loop = _TimeLoop(step_of, controller, order, args, ts, max_steps, near, n, parts)
        out = lax.while_loop(loop.goes_on, loop.step, start)
        return {name: value for name, value in out.items() if name not in ("stage", "control")}

    return run


def _travel(x, near):
    """The largest change of a coordinate since the lists were made."""
    return _largest(x - near[1])


def _watch(slopes, n, k, near):
    """Slopes that are NaN where the lists are not certified, and the arguments they take."""
    if not near:
        return slopes, (k, ())

    def watched(
        t: jax.Array, x: jax.Array, k: jax.Array, near: tuple
    ) -> tuple[jax.Array, jax.Array]:
        dx, dq = slopes.f(t, x, k, near[0])
        return jnp.where(_travel(x, near) <= near[2], dx, jnp.nan), dq

    return type(slopes)(watched, slopes.size), (k, near)
