"""Position-based dynamics in JAX: the coloured order of PBD, level after level.

On a GPU when there is one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.problem import Affine, Distance
from nsbench.solvers.base import Claims, Run, check_positive, grid
from nsbench.solvers.common.hard_particles import hard_particles, mean_radius
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.pbd.kernels.loop_result import LoopResult
from nsbench.solvers.pbd.method import EXPECTS, build_trajectory

DEVICES = ("auto", "cpu", "gpu")
STANDARD = ()


@dataclass(frozen=True)
class PBDJax:
    """`pbd[order=coloured]` as one program of array operations, a level of constraints that share
    no particle at once.

    The same sweep in the same order: the result agrees with the CPU's to rounding. device: "gpu",
    "cpu", or "auto": a GPU when there is one. Its worth begins where a level holds thousands of
    pairs; below, the compiled loop of pbd is faster.
    `reach`: margin of the lists in mean radii; it grows where a step is longer. Sources as for pbd.
    """

    sweeps: int = 1
    seed: int = 0
    reach: float = 0.3
    device: str = "auto"

    accuracy = "h"
    default = 1e-2
    claims = Claims(state=1.0, impulse=1.0)
    expects = EXPECTS

    def __post_init__(self):
        if not (isinstance(self.sweeps, int) and self.sweeps >= 1):
            raise ValueError(f"sweeps is {self.sweeps!r}; a positive whole number is needed")
        if not (isinstance(self.seed, int) and 0 <= self.seed < 2**31):
            raise ValueError(f"seed is {self.seed!r}; a whole number from 0 to 2^31 is needed")
        if self.device not in DEVICES:
            raise ValueError(f"device is {self.device!r}; one of {', '.join(DEVICES)}")
        check_positive("reach", self.reach)

    @property
    def like(self):
        """Return the method on the CPU that has the same sweep."""
        from nsbench.solvers.pbd.method import PBD

        return PBD(sweeps=self.sweeps, order="coloured", seed=self.seed, reach=self.reach)

    def refuses(self, case: Case) -> str | None:
        """Explain why the method does not take the case; None if it does."""
        why = self.like.refuses(case)
        if why:
            return why
        families = case.problem.constraints
        other = next(
            (
                c
                for c in families
                if not isinstance(c, (Affine, Distance)) or getattr(c, "anchors", None) is not None
            ),
            None,
        )
        if other is not None:
            return (
                "PBD in JAX projects on rows and on pairs of particles; this case has anchors "
                "or smooth constraints: use pbd."
            )
        if len({c.dim for c in families if isinstance(c, Distance)}) > 1:
            return "PBD in JAX takes particles of one dimension; this case has several: use pbd."
        if self.device == "gpu" and _device("gpu") is None:
            return (
                "A GPU was asked for and JAX finds none here: use device=cpu, or "
                "pbd[order=coloured], which is faster there."
            )
        return None

    def prepare(self, case: Case, h: float) -> Run:
        """Compile the program for the lists of the start; return the run with the step h."""
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        g = grid(case.t, h, last=case.exact_impulse is not None)
        scene = ConstraintSet(case.problem, case.n)
        x0 = initial_state(case, scene)
        march = _March(self, case, scene, g, x0)
        again = lambda fine, x: _March(self, case, scene, fine, x)().x
        return lambda: build_trajectory(case, g, "compiled", march(), again)


def _device(kind: str):
    """Return the first JAX device of a kind ("auto": its default), or None if there is none."""
    from nsbench.compilation.jax_cache import float64

    jax = float64()
    try:
        return jax.devices()[0] if kind == "auto" else jax.devices(kind)[0]
    except RuntimeError:
        return None


class _March:
    """Run of PBD bound to its program and neighbour lists."""

    def __init__(self, method: PBDJax, case: Case, scene, g, x0):
        from nsbench.dynamics.contacts.kernels.constraint_order import static_keys

        self.method = method
        self.case = case
        self.scene = scene
        self.g = g
        self.x0 = x0
        self.device = _device(method.device)
        from nsbench.solvers.pbd.kernels.neighbor_list import HardScene

        near = scene.all_static()
        self.static_keys = static_keys(near.family, method.like.rank, method.seed)
        hard = hard_particles(scene)
        self.hard_scene = HardScene(
            near.arrays(),
            hard.families,
            hard.radii,
            np.empty(0, np.int64),
            hard.owner,
            method.like.rank,
            method.seed,
        )
        self.dim = next((c.dim for c in case.problem.constraints if isinstance(c, Distance)), 1)
        self.start = method.reach * mean_radius(scene) if scene.hard else 1.0
        self.sizes = (0, 0, 0)
        self.programs = {}
        self.program(*self.lists(x0, self.start))

    def lists(self, x, reach):
        """Return the contacts near x (n,) in the order of the sweep, and their levels."""
        from nsbench.solvers.pbd.kernels.neighbor_list import near_list
        from nsbench.solvers.pbd_jax.program import arrange

        contacts, _ = near_list(np.ascontiguousarray(x), reach, self.hard_scene, self.static_keys)
        levels, self.sizes = arrange(contacts, self.scene, self.hard_scene.owner, self.sizes)
        return contacts, levels

    def program(self, contacts, levels):
        """Return the executable for levels of these sizes, and its arguments on the device."""
        from nsbench.compilation.factories import as_jax
        from nsbench.compilation.jax_cache import float64
        from nsbench.solvers.pbd_jax.program import advance

        jax = float64()
        # as many places for impulses as levels have: the list's own length would mean a program for
        # every list
        room = int(np.prod(levels.pairs[0].shape) + np.prod(levels.rows[2].shape)) + 1
        pairs, rows = (
            (*part[:-1], np.where(part[-1] == len(contacts.kind), room - 1, part[-1]))
            for part in (levels.pairs, levels.rows)
        )
        key = (self.sizes, room)
        with jax.default_device(self.device):
            if key not in self.programs:
                run = advance(
                    as_jax(self.case.problem.drift),
                    _right_sides(self.scene),
                    self.scene.inv2,
                    self.hard_scene.owner[:, 0] >= 0,
                    self.dim,
                    self.method.sweeps,
                )
                self.programs[key] = jax.jit(run)
            return (
                self.programs[key],
                jax.device_put(pairs),
                jax.device_put(rows),
                levels.count,
                room,
            )

    def __call__(self) -> LoopResult:
        """Integrate and return a LoopResult."""
        import jax

        from nsbench.solvers.common.kernels.step_code import StepCode

        g = self.g
        n = self.case.n
        X = np.full((len(g.t), n), np.nan)
        R = np.full((len(g.t), n), np.nan)
        X[0] = self.x0
        R[0] = 0.0
        x = self.x0
        reaction = np.zeros(n)
        reach = self.start
        base = self.x0
        work = 0
        tied = False
        contacts, levels = self.lists(x, reach)
        fresh = True
        rebuilds = 0
        peak = 0
        run, pairs, rows, count, room = self.program(contacts, levels)
        ids = []
        values = []
        with jax.default_device(self.device):
            # PBD between two samples: the program runs until the lists no longer cover the motion.
            for k in range(len(g.t) - 1):
                h = (g.t[k + 1] - g.t[k]) / g.substeps[k]
                s = 0
                mu = np.zeros(room)
                while s < g.substeps[k]:
                    limit = (
                        0.999 * reach / (2.0 * np.sqrt(self.dim))
                        if len(self.hard_scene.hard)
                        else np.inf
                    )
                    x, reaction, mu, after, state, done, ties = run(
                        x,
                        reaction,
                        mu,
                        g.t[k],
                        g.t[k + 1],
                        h,
                        s,
                        int(g.substeps[k]),
                        pairs,
                        rows,
                        count,
                        base,
                        limit,
                    )
                    fresh = fresh and int(after) == s
                    s = int(after)
                    state = int(state)
                    work = work + int(done)
                    tied = tied or bool(ties)
                    if state == 2:
                        end = work, StepCode.NAN, g.t[k] + s * h, rebuilds, peak
                        return LoopResult(X, R, _ids(ids), _flat(values), *end)
                    if state == 1:
                        peak = _flush(k + 1, np.asarray(mu), contacts, ids, values, peak)
                        reach = (
                            2.0 * reach if fresh else reach
                        )  # no step fits into the lists as they are
                        base = np.asarray(x)
                        contacts, levels = self.lists(base, reach)
                        fresh = True
                        rebuilds = rebuilds + 1
                        run, pairs, rows, count, room = self.program(contacts, levels)
                        mu = np.zeros(room)
                X[k + 1], R[k + 1] = np.asarray(x), np.asarray(reaction)
                peak = _flush(k + 1, np.asarray(mu), contacts, ids, values, peak)
        end = work, StepCode.TIED if tied else StepCode.OK, g.t[-1], rebuilds, peak
        return LoopResult(X, R, _ids(ids), _flat(values), *end)


def _right_sides(scene):
    """Return the right-hand sides of all rows as a function of t in JAX."""
    import jax.numpy as jnp

    from nsbench.compilation.factories import as_jax

    parts = [as_jax(c.b) if c.moving else (lambda t, v=c.b: v) for c in scene.affine]
    return (
        (lambda t: jnp.concatenate([jnp.asarray(p(t)) for p in parts]))
        if parts
        else (lambda t: jnp.zeros(0))
    )


def _flush(sample, mu, contacts, ids, values, peak):
    """Append the impulses of a sample to the records ids and values.

    The records are those of kernels.impulse_records. Returns the largest number of constraints that
    acted in one sample so far.
    """
    acted = np.flatnonzero(mu[: len(contacts.kind)])
    ids.append(
        np.stack(
            [
                np.full(len(acted), sample),
                contacts.family[acted],
                contacts.i[acted],
                contacts.j[acted],
            ],
            axis=1,
        )
    )
    values.append(mu[acted])
    return max(peak, len(acted))


def _ids(ids):
    """Concatenate the recorded ids (k, 4)."""
    return np.concatenate([np.empty((0, 4), np.int64), *ids])


def _flat(values):
    """Concatenate the recorded impulses (k,)."""
    return np.concatenate([np.empty(0), *values])


SOLVER = PBDJax
