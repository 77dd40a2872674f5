"""Position-based dynamics in JAX: the coloured order of PBD, level after level.

On a GPU when there is one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.compilation.case_functions import COMPILED
from nsbench.compilation.user_forms.jax_errors import NotTraceable, refusal
from nsbench.problem import Affine, Distance
from nsbench.solvers.base import Claims, Run, check_positive, grid
from nsbench.solvers.common.hard_particles import hard_particles, mean_radius
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.pbd.kernels.loop_result import LoopResult
from nsbench.solvers.pbd.method import EXPECTS, build_trajectory

if TYPE_CHECKING:
    import jax

    from nsbench.dynamics.contacts.kernels.contact_arrays import ListedContacts
    from nsbench.solvers.pbd.method import PBD
    from nsbench.solvers.pbd_jax.program import Levels

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
    has_error_bars = True
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
    def like(self) -> PBD:
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
        from nsbench.solvers.registry import refused

        g = grid(case.t, h, last=case.exact_impulse is not None, states=case.n)
        scene = ConstraintSet(case.problem, case.n)
        x0 = initial_state(case, scene)
        try:
            march = _March(self, case, scene, g, x0)
        except NotTraceable as e:
            why = refusal(case.key, e)
            return lambda: refused(case, why)
        again = lambda fine, x: _March(self, case, scene, fine, x)().x
        return lambda: build_trajectory(case, g, COMPILED, march(), again)


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
        self.trace_functions()
        self.program(*self.lists(x0, self.start))

    def trace_functions(self) -> None:
        """Trace the functions of the case alone; raise NotTraceable where that fails."""
        from nsbench.compilation.factories import as_jax
        from nsbench.compilation.jax_cache import float64

        jax = float64()
        jax.eval_shape(as_jax(self.case.problem.drift), 0.0, self.x0)
        jax.eval_shape(_right_sides(self.scene), 0.0)

    def lists(self, x: np.ndarray, reach: float) -> tuple[ListedContacts, Levels]:
        """Return the contacts near x (n,) in the order of the sweep, and their levels."""
        from nsbench.solvers.pbd.kernels.neighbor_list import near_list
        from nsbench.solvers.pbd_jax.program import arrange

        contacts, _ = near_list(np.ascontiguousarray(x), reach, self.hard_scene, self.static_keys)
        levels, self.sizes = arrange(contacts, self.scene, self.hard_scene.owner, self.sizes)
        return contacts, levels

    def program(self, contacts: ListedContacts, levels: Levels) -> tuple:
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
        X = np.full((len(g.t), self.case.n), np.nan)
        R = np.full((len(g.t), self.case.n), np.nan)
        X[0] = self.x0
        R[0] = 0.0
        progress = _Progress(self.x0, np.zeros(self.case.n), self.x0, self.start)
        progress.contacts, levels = self.lists(self.x0, self.start)
        progress.bound = self.program(progress.contacts, levels)
        code = StepCode.OK
        reached = g.t[-1]
        with jax.default_device(self.device):
            for k in range(len(g.t) - 1):
                failed_at = self.advance(progress, k)
                if failed_at is not None:
                    code = StepCode.NAN
                    reached = failed_at
                    break
                X[k + 1] = np.asarray(progress.x)
                R[k + 1] = np.asarray(progress.reaction)
        if code == StepCode.OK and progress.tied:
            code = StepCode.TIED
        return LoopResult(
            X,
            R,
            _ids(progress.ids),
            _flat(progress.values),
            progress.projections,
            code,
            reached,
            progress.rebuilds,
            progress.peak,
        )

    def advance(self, progress: _Progress, k: int) -> float | None:
        """Do the steps from sample k to the next one; return the time of a failure, or None.

        The program runs until the lists no longer cover the motion; then it goes on with new ones.
        """
        from nsbench.solvers.pbd_jax.program import BROKEN, NAN

        g = self.g
        h = (g.t[k + 1] - g.t[k]) / g.substeps[k]
        s = 0
        run, pairs, rows, count, room = progress.bound
        mu = np.zeros(room)
        while s < g.substeps[k]:
            hard = len(self.hard_scene.hard)
            limit = 0.999 * progress.reach / (2.0 * np.sqrt(self.dim)) if hard else np.inf
            interval = g.t[k], g.t[k + 1], h, s, int(g.substeps[k])
            progress.x, progress.reaction, mu, after, state, done, ties = run(
                progress.x,
                progress.reaction,
                mu,
                *interval,
                pairs,
                rows,
                count,
                progress.base,
                limit,
            )
            progress.is_fresh = progress.is_fresh and int(after) == s
            s = int(after)
            progress.projections += int(done)
            progress.tied = progress.tied or bool(ties)
            if int(state) == NAN:
                return g.t[k] + s * h
            if int(state) == BROKEN:
                progress.record(k + 1, mu)
                self.renew_lists(progress)
                run, pairs, rows, count, room = progress.bound
                mu = np.zeros(room)
        progress.record(k + 1, mu)
        return None

    def renew_lists(self, progress: _Progress) -> None:
        """List the contacts anew at the present state, farther if no step fits into new lists."""
        if progress.is_fresh:
            progress.reach = 2.0 * progress.reach
        progress.base = np.asarray(progress.x)
        progress.contacts, levels = self.lists(progress.base, progress.reach)
        progress.is_fresh = True
        progress.rebuilds += 1
        progress.bound = self.program(progress.contacts, levels)


@dataclass
class _Progress:
    """State of a run between two calls of its program.

    x, reaction (n,): on the device; base (n,): where the lists were built, with the cutoff reach;
    is_fresh: no step was done with them; contacts: the list; bound: what `program` returned; ids,
    values: records of impulse; the rest as in LoopResult.
    """

    x: object
    reaction: object
    base: np.ndarray
    reach: float
    contacts: object = None
    bound: tuple = ()
    is_fresh: bool = True
    projections: int = 0
    tied: bool = False
    rebuilds: int = 0
    peak: int = 0
    ids: list = field(default_factory=list)
    values: list = field(default_factory=list)

    def record(self, sample: int, mu: np.ndarray | jax.Array) -> None:
        """Append the impulses mu of the list to the records of a sample."""
        self.peak = _flush(sample, np.asarray(mu), self.contacts, self.ids, self.values, self.peak)


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
