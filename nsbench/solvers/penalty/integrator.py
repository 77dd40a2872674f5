"""Adaptive integration to given sample times with the Runge-Kutta methods and step controller of
diffrax.

diffrax.diffeqsolve is not used: its loop costs 3 times as long to compile as the one here (8 times
to trace), reads samples off an interpolant, and reports neither why a step was refused nor when no
step can succeed any more.
Explicit methods take their coefficients from diffrax and run through a loop over the stages that
keeps, of the quadratures, two sums. Stages written out one by one take 1.3 to 1.8 times as long to
compile and, on all but chains of links, as long or longer to run: the compiler computes stages
again for each of their sums.
Loaded only when a penalty program is traced, not when it is found in the cache.
"""

from __future__ import annotations

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from nsbench.solvers.penalty.newton import Chord

EXPLICIT = {"bosh3": diffrax.Bosh3, "tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}
IMPLICIT = {"kvaerno3": diffrax.Kvaerno3, "kvaerno5": diffrax.Kvaerno5}
NEVER, TOO_LARGE, NOT_FINITE, NEWTON = range(4)  # why the last step was refused, if it was
REST = 0.6  # of the certified travel: an accepted step that ends beyond it ends the segment


def _largest(z):
    return jnp.max(jnp.abs(z))


def _stepper(slopes, method: str, n: int, rtol, atol):
    """step(t, end, z, args, stage) -> (z1, error, stage, solved), and the first stage (t, z, args)
    -> stage."""
    if method in EXPLICIT:
        return _looped(slopes.f, EXPLICIT[method].tableau, n)
    term = diffrax.ODETerm(lambda t, z, args: jnp.concatenate(slopes.f(t, z[:n], *args)))
    solver = IMPLICIT[method](scan_kind="lax", root_finder=Chord(n, rtol, atol, _largest))

    def step(t, end, z, args, stage):
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

    def step(t, end, z, args, stage):
        h = end - t
        x = z[:n]

        def body(i, c):
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


def integrator(slopes, method: str, n: int, looks: int = 0):
    """run(z0, i, t, h, ts, k, rtol, atol, max_steps, near) -> dict with samples z (K, size), the
    time t reached, counts.

    It goes from z0 at time t to ts[i] and on, with a first step h. Errors are controlled in the
    maximum norm, so that many idle quadratures do not dilute one active. Steps are cut to end at
    samples (the uncut size is kept). Steps too short for floating point and max_steps end the loop
    early: "i" is then less than K, later samples are NaN.
    near: () or (lists, base, reach) where lists hold all that can touch while no coordinate is
    further than `reach` from base (n,). Right-hand sides beyond that are NaN, so that a step that
    asks for one is refused; the loop ends after a step beyond REST of it ("far"), or when such a
    step was refused ("cause" NOT_FINITE).
    way (looks, 1 + size): time and z after the last step in each of so many equal parts of ts, NaN
    where none ended.
    """

    def run(z0, i, t, h, ts, k, rtol, atol, max_steps, near):
        watched, args = _watch(slopes, n, k, near)
        step_of, first = _stepper(watched, method, n, rtol, atol)
        # proportional control where stability limits the step: a third of the refusals of the plain
        # controller
        proportional, integral = (0.3, 0.4) if method in EXPLICIT else (0.0, 1.0)
        controller = diffrax.PIDController(
            rtol=rtol, atol=atol, pcoeff=proportional, icoeff=integral, norm=_largest
        )
        term = diffrax.ODETerm(lambda t, z, args: z)  # no more than its type is looked at
        named = EXPLICIT[method]() if method in EXPLICIT else IMPLICIT[method]()
        order = named.error_order(term)
        _, control = controller.init(term, t, t + h, z0, h, args, named.func, order)
        samples = jnp.full((ts.shape[0], z0.shape[0]), jnp.nan).at[i - 1].set(z0)
        start = dict(
            i=i,
            t=t,
            h=h,
            z=z0,
            stage=first(t, h, z0, args),
            control=control,
            samples=samples,
            accepted=0,
            refused=0,
            cause=NEVER,
            longest=0.0,
            last=0.0,
            far=False,
            way=jnp.full((looks, 1 + z0.shape[0]), jnp.nan),
        )

        def going(c):
            seen = (
                c["t"] + 0.06 * c["h"] > c["t"]
            )  # 8 spacings of t; 0.9 of less than 5 rounds to no less
            on = (c["i"] < ts.shape[0]) & (c["accepted"] + c["refused"] < max_steps) & seen
            return on & ~c["far"] if near else on

        def step(c):
            t = c["t"]
            h = c["h"]
            z = c["z"]
            target = ts[c["i"]]
            cut = t + 1.001 * h >= target
            end = jnp.where(cut, target, t + h)
            z1, error, stage, solved = step_of(t, end, z, args, c["stage"])
            finite = jnp.isfinite(z1).all()
            error = jnp.where(solved & finite & jnp.isfinite(error).all(), error, jnp.inf)
            keep, _, end1, _, control, _ = controller.adapt_step_size(
                t, end, z, z1, args, error, order, c["control"]
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
            if looks:
                part = jnp.clip((t1 - ts[0]) / (ts[-1] - ts[0]) * looks, 0, looks - 1).astype(int)
                way = way.at[part].set(jnp.where(keep, jnp.append(t1, z1), way[part]))
            far = (_travel(z1[:n], near) > REST * near[2]) & keep if near else False
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

        out = lax.while_loop(going, step, start)
        return {
            name: out[name]
            for name in (
                "samples",
                "i",
                "t",
                "h",
                "z",
                "accepted",
                "refused",
                "cause",
                "longest",
                "last",
                "far",
                "way",
            )
        }

    return run


def _travel(x, near):
    """The largest change of a coordinate since the lists were made."""
    return _largest(x - near[1])


def _watch(slopes, n, k, near):
    """Slopes that are NaN where the lists are not certified, and the arguments they take."""
    if not near:
        return slopes, (k, ())

    def watched(t, x, k, near):
        dx, dq = slopes.f(t, x, k, near[0])
        return jnp.where(_travel(x, near) <= near[2], dx, jnp.nan), dq

    return type(slopes)(watched, slopes.size), (k, near)
