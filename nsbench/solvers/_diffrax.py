"""Adaptive integration to given sample times with the Runge-Kutta methods and step controller of diffrax.

diffrax.diffeqsolve is not used: its loop costs 3 times as long to compile as the one here (8 times to trace), reads
samples off an interpolant, and reports neither why a step was refused nor when no step can succeed any more.
Loaded only when a penalty run is prepared.
"""
from __future__ import annotations

import diffrax
import jax
import jax.numpy as jnp
from jax import lax

from nsbench.solvers._newton import Chord

EXPLICIT = {"bosh3": diffrax.Bosh3, "tsit5": diffrax.Tsit5, "dopri8": diffrax.Dopri8}
IMPLICIT = {"kvaerno3": diffrax.Kvaerno3, "kvaerno5": diffrax.Kvaerno5}
NEVER, TOO_LARGE, NOT_FINITE, NEWTON = range(4)      # why the last step was refused, if it was


def _largest(z):
    return jnp.max(jnp.abs(z))


def _stepper(method: str, n: int, rtol, atol):
    if method in EXPLICIT:
        return EXPLICIT[method](scan_kind="lax")
    return IMPLICIT[method](scan_kind="lax", root_finder=Chord(n, rtol, atol, _largest))


def stages(method: str) -> int:
    """Right-hand sides per accepted or refused step of an explicit method (first same as last counted once)."""
    tableau = EXPLICIT[method].tableau
    return tableau.num_stages - (1 if tableau.fsal else 0)


def integrator(rhs, method: str, n: int):
    """(z0, ts, k, rtol, atol, max_steps) -> dict with samples z (K, size), the time t reached and counts.

    Errors are controlled in the maximum norm, so that many idle quadratures do not dilute one active. Steps are cut to
    end at samples (the uncut size is kept). Steps too short for floating point and max_steps end the loop early:
    "i" is then less than K, and the remaining samples NaN.
    """
    term = diffrax.ODETerm(rhs)

    def run(z0, ts, k, rtol, atol, max_steps):
        solver = _stepper(method, n, rtol, atol)
        # proportional control where stability limits the step: a third of the refusals of the plain controller
        proportional, integral = (0.3, 0.4) if method in EXPLICIT else (0.0, 1.0)
        controller = diffrax.PIDController(rtol=rtol, atol=atol, pcoeff=proportional, icoeff=integral, norm=_largest)
        order = solver.error_order(term)
        # a first step within the stiffness 1/k; the controller multiplies it by up to 10 a step
        h = 0.1 * jnp.minimum(ts[1] - ts[0], 1.0 / k)
        _, control = controller.init(term, ts[0], ts[0] + h, z0, h, k, solver.func, order)
        samples = jnp.full((ts.shape[0], z0.shape[0]), jnp.nan).at[0].set(z0)
        start = dict(i=1, t=ts[0], h=h, z=z0, stage=solver.init(term, ts[0], ts[0] + h, z0, k), control=control,
                     samples=samples, accepted=0, refused=0, cause=NEVER, longest=0.0, last=0.0)

        def going(c):
            seen = c["t"] + 0.06 * c["h"] > c["t"]         # 8 spacings of t; 0.9 of less than 5 rounds to no less
            return (c["i"] < ts.shape[0]) & (c["accepted"] + c["refused"] < max_steps) & seen

        def step(c):
            t, h, z, target = c["t"], c["h"], c["z"], ts[c["i"]]
            cut = t + 1.001 * h >= target
            end = jnp.where(cut, target, t + h)
            z1, error, _, stage, result = solver.step(term, t, end, z, k, c["stage"], False)
            solved = result == diffrax.RESULTS.successful
            finite = jnp.isfinite(z1).all()
            error = jnp.where(solved & finite & jnp.isfinite(error).all(), error, jnp.inf)
            keep, _, end1, _, control, _ = controller.adapt_step_size(t, end, z, z1, k, error, order, c["control"])
            t1 = jnp.where(keep, end, t)
            h1 = jnp.where(keep & cut, jnp.maximum(end1 - t1, h), end1 - t1)
            cause = jnp.where(keep, NEVER, jnp.where(finite, jnp.where(solved, TOO_LARGE, NEWTON), NOT_FINITE))
            choose = lambda new, old: jax.tree_util.tree_map(lambda a, b: jnp.where(keep, a, b), new, old)
            arrived = keep & cut
            samples = c["samples"].at[c["i"]].set(jnp.where(arrived, z1, jnp.nan))
            return dict(i=c["i"] + arrived, t=t1, h=h1, z=choose(z1, z), stage=choose(stage, c["stage"]),
                        control=control, samples=samples, accepted=c["accepted"] + keep, refused=c["refused"] + ~keep,
                        cause=cause, longest=jnp.maximum(c["longest"], t1 - t),
                        last=jnp.where(keep, end - t, c["last"]))

        out = lax.while_loop(going, step, start)
        return {name: out[name] for name in
                ("samples", "i", "t", "h", "z", "accepted", "refused", "cause", "longest", "last")}
    return run
