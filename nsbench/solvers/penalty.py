"""Smoothed penalty: constraints as stiff springs, switches as thin layers, integrated by diffrax in float64."""
from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from nsbench.case import Case
from nsbench.problem import LCS, Complementarity
from nsbench.solvers.base import Claims, Expect, Run, check_positive
from nsbench.solvers.start import start_state
from nsbench.trajectory import Status, Trajectory

EXPLICIT = ("tsit5", "dopri8", "bosh3")
IMPLICIT = ("kvaerno3", "kvaerno5")
PAIRS = 6000              # constraints whose impulses are integrated: 110 discs
HIDDEN = 0.0101           # k times tolerance, kept up to k = 1e7 at 1e-9: up to 190 tolerances of error were measured
EXPECTS = (
    Expect(("zeno",), None, None, "no rate is known for a smoothed sign at an accumulation of events"),
    Expect(("infeasible_start",), None, None, "what a method makes of an infeasible start is its meaning, not its error"),
)


@dataclass(frozen=True)
class Penalty:
    """x' = f + sum_k lam_k grad g_k with lam_k = k max(-g_k, 0); the error is O(1/k), the stiffness O(k).

    Filippov systems: the sign of a surface c becomes clip(k c, -1, 1), a layer of half-width eps = 1/k. Impulses and
    reaction are integrated as further states. method: explicit "tsit5", "dopri8", "bosh3" (about k T / 3 steps), or
    implicit "kvaerno3", "kvaerno5" (dearer steps and 4 times the compile time, but their number does not grow with k).
    rtol and atol are those of the step control; max_steps counts refused steps too. Every right-hand side visits all
    pairs of particles.
    Source: Moreau-Yosida regularisation of a projected system; integrators by Kidger (2021), Tsitouras (2011), Prince &
    Dormand (1981), Bogacki & Shampine (1989), Kvaerno (2004).
    """
    method: str = "tsit5"
    rtol: float = 1e-9
    atol: float = 1e-9
    max_steps: int = 1_000_000

    accuracy = "k"
    default = 1e4
    claims = Claims(state=1.0, impulse=1.0)
    expects = EXPECTS
    ladder = (30.0, 3840.0)       # k of an order study: 7 octaves which an explicit method takes in seconds

    def __post_init__(self):
        if self.method not in EXPLICIT + IMPLICIT:
            raise ValueError(f"method is {self.method!r}; one of {', '.join(EXPLICIT + IMPLICIT)}")
        check_positive("rtol", self.rtol)
        check_positive("atol", self.atol)
        if not (isinstance(self.max_steps, int) and self.max_steps >= 1):
            raise ValueError(f"max_steps is {self.max_steps!r}; a positive whole number is needed")

    def refuses(self, case: Case) -> str | None:
        p = case.problem
        if isinstance(p, LCS):
            return "A penalty needs constraints with gradients or switches; this one is a linear complementarity system."
        if isinstance(p, Complementarity) and not p.constraints:
            return "A penalty needs constraints; this case has none (only its integrator would remain)."
        from nsbench.solvers._forces import count
        m = count(p, case.n)
        if m > PAIRS:
            return (f"A penalty integrates an impulse for every constraint, here {m}, in every stage of every step "
                    f"({m * len(case.t) * 8 / 1e6:.0f} MB of samples); at most {PAIRS} are taken: use pbd or "
                    "catching_up.")
        return None

    def prepare(self, case: Case, k: float) -> Run:
        k = check_positive("k", k)
        x0 = _start(case)
        try:
            compiled, ids = _compiled(case.problem, case.n, len(case.t), self.method)
        except _NotTraceable as e:
            why = f"JAX cannot trace the functions of {case.key} (do they use the array namespace they are given?): {e}."
            return lambda: _nothing(case, why)
        size = compiled.size
        z0 = np.concatenate([x0, np.zeros(size - case.n)])
        arguments = (z0, case.t, k, float(self.rtol), float(self.atol), self.max_steps)
        return lambda: _trajectory(self, case, k, ids, {a: np.asarray(v) for a, v in compiled(*arguments).items()})


class _NotTraceable(Exception):
    """A factory of the case is not a function of JAX arrays; the message says why."""


@dataclass(frozen=True)
class _Compiled:
    """An executable for a state with quadratures of `size` entries in all."""
    run: object
    size: int

    def __call__(self, *arguments):
        _float64()
        return self.run(*arguments)


def _float64():
    """JAX in float64, whoever imported it before."""
    import jax
    if not jax.config.jax_enable_x64:
        jax.config.update("jax_enable_x64", True)
    return jax


@lru_cache(maxsize=64)
def _compiled(problem, n: int, samples: int, method: str):
    """(executable, contact ids). Start, times, k, tolerances and step limit are arguments: one compilation serves all."""
    jax = _float64()
    import jax.numpy as jnp

    from nsbench.solvers._diffrax import integrator
    from nsbench.solvers._forces import constraint_ids, right_hand_side
    ids = constraint_ids(problem, n)
    size = n + len(ids) + (n if isinstance(problem, Complementarity) else 0)
    rhs = right_hand_side(problem, n)
    vector = lambda length: jax.ShapeDtypeStruct((length,), jnp.float64)
    try:
        slope = jax.eval_shape(rhs, 0.0, vector(size), 1.0)
    except (TypeError, AttributeError, IndexError, ValueError, NotImplementedError) as e:
        raise _NotTraceable(f"{type(e).__name__}: {str(e).strip().splitlines()[0].rstrip('.')}") from None
    if slope.dtype != jnp.float64:
        raise _NotTraceable(f"they return {slope.dtype}, float64 is needed")
    number, whole = jax.ShapeDtypeStruct((), jnp.float64), jax.ShapeDtypeStruct((), jnp.int64)
    with jax.default_device(jax.devices("cpu")[0]):      # a loop of tiny operations: an accelerator only adds latency
        lowered = jax.jit(integrator(rhs, method, n)).lower(
            vector(size), vector(samples), number, number, number, whole)
        return _Compiled(lowered.compile(), size), tuple(ids)


def _start(case: Case) -> np.ndarray:
    if not isinstance(case.problem, Complementarity):
        return case.x0.copy()
    from nsbench.contacts import Scene
    return start_state(case, Scene(case.problem, case.n))


def _nothing(case: Case, why: str) -> Trajectory:
    return Trajectory(np.empty(0), np.empty((0, case.n)), (), np.empty((0, 0)), np.empty((0, case.n)),
                      Status("refused", why))


def _trajectory(penalty: Penalty, case: Case, k: float, ids: tuple, out: dict) -> Trajectory:
    n, m, z = case.n, len(ids), out["samples"]
    impulse, reaction = z[:, n:n + m], z[:, n + m:]
    reached = z[:int(out["i"])]
    pushes = np.diff(reached[:, n:n + m], axis=0) > 0.0
    acted = np.arange(m)
    if isinstance(case.problem, Complementarity):
        acted = np.flatnonzero(pushes.any(axis=0))
    steps, refused = int(out["accepted"]), int(out["refused"])
    stats = {"steps": steps, "h": 1.0 / k, "refused_steps": refused, "longest_step": float(out["longest"]),
             "contacts_peak": int(pushes.sum(axis=1).max(initial=0)), "loop": "compiled"}
    if penalty.method in EXPLICIT:
        from nsbench.solvers._diffrax import stages
        stats["drift_calls"] = 1 + (steps + refused) * stages(penalty.method)
    return Trajectory(case.t, z[:, :n].copy(), tuple(ids[a] for a in acted), impulse[:, acted], reaction.copy(),
                      _status(penalty, case, k, out), (), stats, "mean")


def _status(penalty: Penalty, case: Case, k: float, out: dict) -> Status:
    """What became of the run, judged by the samples themselves."""
    t, tried = float(out["t"]), int(out["accepted"]) + int(out["refused"])
    at = f"at t = {t:.6g} of {case.t[-1]:g}"
    if int(out["i"]) == len(case.t) and np.isfinite(out["samples"]).all():
        worst = max(penalty.rtol, penalty.atol)
        if k * worst > HIDDEN:
            return Status("unverified", f"The error of the penalty, about 1/k = {1 / k:.1e}, may be hidden by the "
                                        f"integrator's, up to 200 times its tolerance {worst:.1e}: lower rtol and atol.")
        return Status()
    if tried < penalty.max_steps:
        return _no_step(penalty, case, k, out, at)
    last = float(out["last"])
    advice = ("an explicit method needs about k T / 3 of them: take method=kvaerno5 or a smaller k"
              if penalty.method in EXPLICIT else "raise max_steps, rtol or atol")
    return Status("maxiter", f"The penalty is too stiff for {penalty.max_steps} steps: {at} their length was {last:.1e} "
                             f"(k h = {k * last:.2g}); {advice}.")


def _no_step(penalty: Penalty, case: Case, k: float, out: dict, at: str) -> Status:
    """Why no step succeeds, however short."""
    from nsbench.solvers._diffrax import NEWTON, NOT_FINITE
    if np.abs(out["z"][:case.n]).max() > 1e6 * (1.0 + np.abs(case.x0).max()):
        return Status("diverged", f"The state grew beyond all bounds {at}.")
    if out["cause"] == NOT_FINITE:
        return Status("nan", f"The right-hand side is not finite just after the point reached {at}.")
    if out["cause"] == NEWTON:
        return Status("maxiter", f"Newton's iteration of {penalty.method} failed at every step size {at}; lower k.")
    return Status("maxiter", f"The step size fell to {float(out['h']):.1e} {at}: the tolerances cannot be met at "
                             f"k = {k:g} in double precision; raise rtol and atol or lower k.")


SOLVER = Penalty
