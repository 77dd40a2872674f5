"""Position-based dynamics: explicit Euler, then one exact projection per constraint, in order.

    y = x + h f(t, x),    x+ = P_m o ... o P_1 (y)

P_k projects on {g_k >= 0} along grad g_k alone; rows and pairs of particles have it in closed form
(kernels/projection.py), smooth constraints by Newton's method (host_loop.py). Three compiled loops
do the same sweep with the same bits:

    kernels/listed_loop.py     every constraint is listed
    kernels/neighbor_loop.py   hard particles by neighbour lists
    kernels/cell_loop.py       one family of hard particles, stored by cells: the fastest

A change of the projection is made in all of these places; tests compare their bits or values:

    rows       kernels/projection.project_row, kernels/cell_sweep.project_stored_row,
               pbd_jax/program._project_rows
    pairs      kernels/projection.project_pair, kernels/cell_sweep.project_stored_pair (any
               dimension), kernels/cell_sweep.sweep_discs (equal discs in the plane, inlined),
               pbd_jax/program._project_pairs
    anchors    kernels/projection.project_anchor
    smooth     host_loop.project_smooth

Copies that follow none of these, as they are for something else: the baseline kdtree
(kdtree/kernels/pair_sweep.py, kdtree/method._jacobi), the study of chains
(studies/chain/large_steps.project_pair), the linearised sweep (studies/packings/linear_sweep), and
the sweep that takes impulses back (studies/multipliers/kernels/accumulated_loop).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
from nsbench.problem import Affine, Complementarity, Smooth
from nsbench.solvers.base import Expect, Grid, Run, grid, last_steps
from nsbench.solvers.common.divergence import classify_divergence
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.common.time_grid import between_samples, check_positive, samples
from nsbench.solvers.common.tolerance_run import StepOrTolerance
from nsbench.solvers.pbd.sweep_order import ORDERS, hard_ranks, order_number, ordered_arrays
from nsbench.trajectory import Resolution, Status, Trajectory

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.solvers.pbd.kernels.loop_result import LoopResult

EXPECTS = (
    Expect(
        ("exact_at_grid",),
        "exact",
        "exact",
        "every step of Euler is exact for a drift that is constant in each mode",
    ),
    Expect(
        ("infeasible_start",),
        None,
        None,
        "what a method makes of an infeasible start is its meaning, not its error",
    ),
)
# with fixed steps, and with steps that are chosen for a tolerance
STANDARD = ("pbd", "pbd[tol=1e-2]")


@dataclass(frozen=True)
class PBD(StepOrTolerance):
    """Step by explicit Euler, then by `sweeps` sweeps of exact projections P_m o ... o P_1.

    order: of the sweep, part of the method. "sorted" (families as the case lists them, indices
    ascending), "reverse", "random": one permutation of all constraints, the same in every step,
    drawn from `seed`; "cell": sorted, with hard particles renumbered once by cells of the start, as
    large as the largest of them; "coloured": sorted, with the pairs of a hard family by colours of
    their labels (constraint_order), few of which follow on one another, so that many can be done at
    once. No order depends on the list or the step.
    reach: margin of the neighbour list in mean radii; the result does not depend on it.
    tol: steps are chosen along the run so that its error bars, in the 2-norm of the state, stay
    below a tolerance (common/tolerance_run.py); the accuracy is then "tol" in the place of "h".
    The multiplier estimate of constraint k in a step is displacement along grad g_k / (h |grad
    g_k|), stored as impulse. Coincident centres are parted along the first axis and the run is
    marked "degenerate".
    Source: Mueller et al. 2007; as a method for complementarity systems Plunder & Merino-Aceituno,
    arXiv 2310.01215.
    """

    sweeps: int = 1
    order: str = "sorted"
    seed: int = 0
    reach: float = 1.0
    tol: float | None = None

    expects = EXPECTS

    def __post_init__(self):
        if self.order not in ORDERS:
            raise ValueError(f"order is {self.order!r}; one of {', '.join(ORDERS)}")
        if not (isinstance(self.sweeps, int) and self.sweeps >= 1):
            raise ValueError(f"sweeps is {self.sweeps!r}; a positive whole number is needed")
        if not (isinstance(self.seed, int) and 0 <= self.seed < 2**31):
            raise ValueError(f"seed is {self.seed!r}; a whole number from 0 to 2^31 is needed")
        if not self.reach > 0:
            raise ValueError(f"reach is {self.reach!r}; a positive number is needed")
        if self.tol is not None:
            check_positive("tol", self.tol)

    @property
    def rank(self) -> int:
        """Return the number of the order, as constraint_order counts them."""
        return order_number(self.order)

    def refuses(self, case: Case) -> str | None:
        if not isinstance(case.problem, Complementarity):
            kind = case.problem.kind
            return f"PBD needs constraints to project on; this case is a {kind}."
        if not case.problem.constraints:
            return (
                "PBD needs constraints to project on; this case has none (it would be explicit "
                "Euler: use euler)."
            )
        return self.refuses_tolerance(case)

    def prepare(self, case: Case, h: float) -> Run:
        if self.tol is not None:
            return self.prepare_tolerance(case, h)
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        g = grid(case.t, h, last=case.exact_impulse is not None, states=case.n)
        scene = ConstraintSet(case.problem, case.n)
        x0 = initial_state(case, scene)
        if any(isinstance(c, Smooth) for c in scene.families):
            from nsbench.compilation.case_functions import in_python
            from nsbench.solvers.pbd.host_loop import prepare

            march = prepare(self, case, scene, g, x0)
            loop = in_python("Smooth constraints are projected by Newton's method there")
            again = lambda fine, x: prepare(self, case, scene, fine, x)().x
        else:
            march, loop = self._compiled(case, scene, g, x0)
            again = lambda fine, x: self._compiled(case, scene, fine, x)[0]().x
        return lambda: build_trajectory(case, g, loop, march(), again)

    def _compiled(self, case, scene, g, x0):
        """Return the time loop bound to its data, and what the run says of it."""
        if is_cell_scene(scene):
            return self._by_cells(case, scene, g, x0)
        return self._listed(case, scene, g, x0)

    def _by_cells(self, case, scene, g, x0, record=True):
        """Bind cell_loop; should its lists get too long, the run is done by _listed.

        The work arrays of candidates are allocated once; those of the state at each run, as the
        trajectory takes their room.
        """
        from nsbench.compilation.case_functions import (
            bind_loop,
            compile_functions,
            module_in_python,
        )
        from nsbench.solvers.common.hard_particles import mean_radius
        from nsbench.solvers.common.kernels.step_code import StepCode
        from nsbench.solvers.pbd.kernels import cell_loop
        from nsbench.solvers.pbd.kernels.cell_storage import candidate_arrays

        functions = compile_functions(*_drift_and_walls(case, scene), start=(case.t[0], x0))
        data, m = self._cell_scene(case, scene, x0, record)
        head = (*functions.functions, g.t, g.substeps, self.sweeps, x0)
        head = (*head, self.reach * mean_radius(scene), data)
        arrays = candidate_arrays.py_func(cell_loop.first_size(m))
        none = np.empty((1, 1))
        march = bind_loop(
            cell_loop.march,
            functions.loop,
            (*head, cell_loop.cell_state(m, case.n), arrays, none, none),
            module_in_python,
        )

        def run() -> LoopResult:
            X = np.empty((len(g.t), case.n))
            R = np.empty((len(g.t), case.n))
            out = march(*head, cell_loop.cell_state(m, case.n), arrays, X, R)
            if out.code != StepCode.LIST_OVERFLOW:
                return out._replace(contacts_peak=out.contacts_peak + scene.inv2.size)
            return self._listed(case, scene, g, x0)[0]()

        return run, functions.stats

    def _cell_scene(self, case, scene, x0, record):
        """Return the CellScene of the scene, and the number of its particles."""
        from nsbench.solvers.pbd.kernels.cell_storage import CellScene

        ((k, c, m),) = scene.hard
        radii = scene.radii[k]
        data = CellScene(
            rows=AffineRows(scene.ptr, scene.cols, scene.vals, scene.inv2),
            b=scene.b(float(case.t[0])),
            r=radii[:1].copy() if np.all(radii == radii[0]) else radii,
            ranks=hard_ranks(scene, self.order, x0),
            families=np.array([(k, 0), *zip(*_first_rows(scene), strict=True)], np.int64),
            dim=c.dim,
            moving=scene.moving,
            order=self.rank,
            seed=self.seed,
            record=record,
        )
        return data, m

    def _listed(self, case, scene, g, x0):
        """Bind the loop for any scene without Smooth constraints: neighbor_loop or listed_loop."""
        from nsbench.compilation.case_functions import (
            bind_loop,
            compile_functions,
            module_in_python,
        )
        from nsbench.solvers.common.hard_particles import hard_particles, mean_radius

        t0 = float(case.t[0])
        functions = compile_functions(
            *_drift_and_walls(case, scene), _anchors(scene), start=(t0, x0)
        )
        rows = AffineRows(scene.ptr, scene.cols, scene.vals, scene.inv2)
        head = (*functions.functions, scene.moving, g.t, g.substeps, self.sweeps, x0)
        walls = (rows, scene.b(t0), scene.anchors(t0))
        if scene.hard:
            from nsbench.solvers.pbd.kernels.neighbor_loop import HardScene, march

            hard = hard_particles(scene)
            data = HardScene(
                scene.all_static().arrays(),
                hard.families,
                hard.radii,
                hard_ranks(scene, self.order, x0),
                hard.owner,
                self.rank,
                self.seed,
            )
            args = (*head, data, *walls, self.reach * mean_radius(scene))
        else:
            from nsbench.solvers.pbd.kernels.listed_loop import march

            args = (*head, ordered_arrays(scene.all_static(), self.order, self.seed), *walls)
        bound = bind_loop(march, functions.loop, args, module_in_python)
        return (lambda: bound(*args)), functions.stats


def _drift_and_walls(case, scene):
    """Describe the drift and the constants b(t) of the rows as functions of a time loop."""
    from nsbench.compilation.case_functions import curve_function, drift_function

    return (
        drift_function(case.problem.drift, case.n),
        curve_function(scene.b_factory, scene.inv2.size, scene.b),
    )


def _anchors(scene):
    """Describe the coordinates of the anchors as a function of a time loop."""
    from nsbench.compilation.case_functions import curve_function

    size = scene.anchors(0.0).size if scene.anchor_factory else 0
    return curve_function(scene.anchor_factory, size, scene.anchors)


def is_cell_scene(scene: ConstraintSet) -> bool:
    """Return whether cell_loop takes the scene.

    It takes hard particles of one family that own all coordinates, with affine rows besides, each
    of them on one particle.
    """
    if len(scene.hard) != 1 or not all(
        isinstance(c, Affine) or c is scene.hard[0][1] for c in scene.families
    ):
        return False
    ((_, c, m),) = scene.hard
    owner = scene.cols // c.dim
    return (
        c.start == 0
        and m * c.dim == scene.n
        and bool(np.all(owner == np.repeat(owner[scene.ptr[:-1]], np.diff(scene.ptr))))
    )


def _first_rows(scene):
    """Return the families of rows, and the first row of each among all."""
    k = [k for k, c in enumerate(scene.families) if isinstance(c, Affine)]
    return k, np.cumsum([0, *(a.shape[0] for a in scene.affine)])[:-1].tolist()


def build_trajectory(
    case: Case, g: Grid, loop: dict, out: LoopResult, again: Callable | None = None
) -> Trajectory:
    """Return the trajectory of a run on the grid g from its LoopResult.

    loop: what the run says of its loop. again(grid, x) -> X (K, n): the same run on another grid,
    to see how a state that is not finite came about.
    """
    from nsbench.dynamics.contacts.kernels.impulse_records import cumulate
    from nsbench.solvers.common.kernels.step_code import StepCode

    contacts, impulse = cumulate(out.ids, out.values, len(g.t))
    steps = int(g.substeps.sum())
    stats = {
        "steps": steps,
        "h": g.h,
        "drift_calls": steps,
        "projections": int(out.projections),
        **loop,
    }
    if out.rebuilds >= 0:
        stats |= {"rebuilds": int(out.rebuilds), "contacts_peak": int(out.contacts_peak)}
    X = out.x
    R = out.reaction
    if out.code == StepCode.NAN:
        impulse[~np.isfinite(X[:, 0])] = np.nan
    status = _status(g, out, again)
    lam = last_steps(case.t, g, impulse)
    between = between_samples(case.t, g, X, impulse)
    if not g.aligned:
        X, R, impulse = samples(case.t, g.t, X, R, impulse)
    # the drift that the multiplier balances is taken at the start of the step
    return Trajectory(
        case.t,
        X,
        contacts,
        impulse,
        R,
        status,
        stats=stats,
        lam_time="start",
        **lam,
        between=between,
        resolution=Resolution(step=g.h, rule="explicit"),
    )


def _status(g, out, again):
    from nsbench.solvers.common.loop_status import status_of
    from nsbench.solvers.common.kernels.step_code import StepCode

    if out.code == StepCode.NAN:
        return classify_divergence(g, out.x, out.reached, again)
    coincident = Status(
        "degenerate",
        "Coincident centres: the contact has no normal; they were parted along the first axis.",
    )
    return status_of(out.code, out.reached, {StepCode.TIED: coincident})


SOLVER = PBD
