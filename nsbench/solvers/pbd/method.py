"""Position-based dynamics: explicit Euler, then one exact projection per constraint, in a stated
order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.problem import Affine, Complementarity, Smooth
from nsbench.solvers.base import Claims, Expect, Run, grid, last_steps, sample
from nsbench.solvers.common.divergence import classify_divergence
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.pbd.sweep_order import hard_ranks
from nsbench.trajectory import Resolution, Status, Trajectory

MANY_THREADS = 32
THREADED = ("random", "coloured")  # orders in which few constraints wait for far ones
ORDERS = ("sorted", "reverse", "random", "cell", "coloured")  # as kernels.keys numbers them
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


@dataclass(frozen=True)
class PBD:
    """Explicit Euler, then `sweeps` sweeps of exact projections prox_{g_m} o ... o prox_{g_1}.

    The order of the sweep is part of the method: "sorted" (families as the case lists them, indices
    ascending), "reverse", "random": one permutation of all constraints, the same in every step,
    drawn from `seed`; "cell": sorted, with hard particles renumbered once by cells of the start, as
    large as the largest of them; "coloured": sorted, with the pairs of a hard family by colours of
    their labels (kernels.keys), few of which follow on one another, so that many can be done at
    once. No order depends on the list, the step or the number of threads.
    The multiplier estimate of constraint k in a step is displacement along grad g_k / (h |grad
    g_k|), kept as impulse. `reach`: margin of the neighbour list in mean radii; the result does not
    depend on it. Coincident centres are parted along the first axis and the run is marked
    "degenerate".
    `threads`: for random and coloured orders over one family of hard particles; the result is that
    of one, bit for bit.
    They are this run's own (beside those of other workers, whatever NUMBA_NUM_THREADS says), and
    wait by looking: they pay where processors are idle and particles many.
    Source: Mueller et al. 2007; as a method for complementarity systems Plunder & Merino-Aceituno,
    arXiv 2310.01215.
    """

    sweeps: int = 1
    order: str = "sorted"
    seed: int = 0
    reach: float = 1.0
    threads: int = 1

    accuracy = "h"
    default = 1e-2
    claims = Claims(state=1.0, impulse=1.0)
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
        if not (isinstance(self.threads, int) and 1 <= self.threads <= MANY_THREADS):
            raise ValueError(
                f"threads is {self.threads!r}; a whole number from 1 to {MANY_THREADS}"
            )

    @property
    def rank(self) -> int:
        """Number of the order, as kernels.keys counts them."""
        return ORDERS.index(self.order)

    def refuses(self, case: Case) -> str | None:
        if not isinstance(case.problem, Complementarity):
            return "PBD needs constraints to project on; this case is a " + (
                "Filippov system."
                if type(case.problem).__name__ == "Filippov"
                else "linear complementarity system."
            )
        if not case.problem.constraints:
            return (
                "PBD needs constraints to project on; this case has none (it would be explicit "
                "Euler: use euler)."
            )
        return self._refuses_threads(case) if self.threads > 1 else None

    def _refuses_threads(self, case: Case) -> str | None:
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        if self.order not in THREADED:
            return (
                f"Threads need an order in which few constraints wait for far ones: "
                f"{' or '.join(THREADED)}, not "
                f"{self.order}; use one thread."
            )
        scene = ConstraintSet(case.problem, case.n)
        if not packs(scene):
            return (
                "Threads share hard particles of one family and rows on single ones; this case "
                "has other constraints: "
                "use one thread."
            )
        if _pointers(case, scene)[1] != "compiled":
            return (
                "Threads need a drift that numba compiles; this one runs in Python: use one thread."
            )
        return None

    def prepare(self, case: Case, h: float) -> Run:
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        g = grid(case.t, h, last=case.exact_impulse is not None)
        scene = ConstraintSet(case.problem, case.n)
        x0 = initial_state(case, scene)
        if any(isinstance(c, Smooth) for c in scene.families):
            from nsbench.solvers.pbd.host_loop import prepare

            march = prepare(self, case, scene, g, x0)
            loop = "host"
            again = lambda fine, x: prepare(self, case, scene, fine, x)()[0]
        else:
            march, loop = self._compiled(case, scene, g, x0)
            again = lambda fine, x: self._compiled(case, scene, fine, x)[0]()[0]
        return lambda: _trajectory(case, g, loop, march(), again)

    def _compiled(self, case, scene, g, x0):
        """The compiled loop bound to its data, and "compiled" or "host": the same loop around a
        drift in Python."""
        if packs(scene):
            return self._packed(case, scene, g, x0)
        return self._listed(case, scene, g, x0)

    def _packed(self, case, scene, g, x0, record=True):
        """The fast loop for one family of hard particles; should its lists get too long, the one
        for all scenes."""
        from nsbench.solvers.pbd.kernels import cell_loop as kernel

        (f, b, _), loop = _pointers(case, scene)
        ((k, c, m),) = scene.hard
        families = np.array([(k, 0), *zip(*_first_rows(scene), strict=True)], np.int64)
        radii = scene.radii[k]
        args = (
            f,
            b,
            scene.moving,
            g.t,
            g.substeps,
            self.sweeps,
            x0,
            (scene.ptr, scene.cols, scene.vals, scene.inv2),
            scene.b(float(case.t[0])),
            radii[:1].copy() if np.all(radii == radii[0]) else radii,
            hard_ranks(scene, self.order, x0),
            families,
            c.dim,
            self.reach * _mean_radius(scene),
            self.rank,
            self.seed,
            record,
        )
        if self.threads > 1:
            march = _threaded(kernel, self.threads, args, case.n, len(g.t), m)
        else:
            march = _alone(kernel, loop, args, case.n, len(g.t), m)

        def run():
            out = march()
            if out[5] != kernel.TOO_MANY:
                return (*out[:8], out[8] + scene.inv2.size)
            return self._listed(case, scene, g, x0)[0]()

        return run, loop

    def _listed(self, case, scene, g, x0):
        """The loop for any scene, all of whose constraints are listed."""
        if scene.hard:
            from nsbench.solvers.pbd.kernels import neighbor_loop as kernel
        else:
            from nsbench.solvers.pbd.kernels import listed_loop as kernel
        t0 = float(case.t[0])
        pointers, loop = _pointers(case, scene)
        rows = (scene.ptr, scene.cols, scene.vals, scene.inv2)
        head = (*pointers, scene.moving, g.t, g.substeps, self.sweeps, x0)
        walls = (rows, scene.b(t0), scene.anchors(t0))
        if scene.hard:
            hard, radii, owner = _hard(scene)
            args = (
                *head,
                scene.all_static().arrays(),
                *walls,
                hard,
                radii,
                hard_ranks(scene, self.order, x0),
                owner,
                self.reach * _mean_radius(scene),
                self.rank,
                self.seed,
            )
        else:
            args = (*head, _ordered(scene.all_static(), self), *walls)
        march = kernel.march if loop == "compiled" else kernel.march.py_func
        if loop == "compiled":
            march.compile(_types(args))
        return (lambda: march(*args)), loop


def _alone(kernel, loop, args, n, samples, m):
    """The march of kernels.pbd_packed on one thread: without arguments, and its lists are made
    once. (Its state is not: the trajectory has that room when it is made.)"""
    state, *lists = kernel.room(m, n)
    if loop == "compiled":
        kernel.march.compile(_types((*args, None, np.empty((2, 1, 1)), state, *lists)))
    march = kernel.march if loop == "compiled" else kernel.march.py_func
    shape = state.shape
    del state
    return lambda: march(*args, None, np.empty((2, samples, n)), np.empty(shape), *lists)


def _threaded(kernel, threads, args, n, samples, m):
    """The same on several threads; where lists outgrow their arrays, begun anew with longer
    ones."""
    from nsbench.solvers.pbd.kernels import threaded_loop

    room = [kernel.room(m, n)]

    def bound(X):
        return threaded_loop.crew(threads, args[12], args[2], args[16], X, room[0], *args[7:10])

    crew = bound(np.empty((2, 1, n)))
    kernel.march.compile(_types((*args, crew, crew[6], *room[0])))
    threaded_loop.serve.compile(_types((1, crew)))

    def march():
        while True:
            crew = bound(np.empty((2, samples, n)))
            out = threaded_loop.run_with(crew, kernel.march, (*args, crew, crew[6], *room[0]))
            if out[5] != kernel.TOO_SMALL:
                return out
            room[0] = kernel.room(m, n, int(out[4]))

    return march


def _types(args):
    from numba import typeof

    return tuple(typeof(a) for a in args)


def _pointers(case, scene):
    """Drift, walls and anchors as pointers; where numba cannot compile them, the same in numpy."""
    from nsbench.compilation import factories

    try:
        f = factories.rhs_cfunc(case.problem.drift, case.n)
        b = (
            factories.curve_cfunc(scene.b_factory, scene.inv2.size)
            if scene.b_factory
            else factories.constant_curve()
        )
        a = (
            factories.curve_cfunc(scene.anchor_factory, scene.anchors(0.0).size)
            if scene.anchor_factory
            else factories.constant_curve()
        )
        return (f, b, a), "compiled"
    except factories.CompileError:
        return tuple(
            _filler(g) for g in (factories.as_numpy(case.problem.drift), scene.b, scene.anchors)
        ), "host"


def _filler(function):
    def fill(*args):
        args[-1][:] = function(*args[:-1])

    return fill


def _ordered(near, method):
    """Arrays of the listed constraints in the order of the sweep."""
    if method.order == "sorted":
        return near.arrays()
    from nsbench.dynamics.contacts.kernels.constraint_order import static_keys

    return near.take(np.argsort(static_keys(near.family, method.rank, method.seed))).arrays()


def _hard(scene):
    """Kernel arrays of the hard families: (family, start, particles, dim), radii, and who owns a
    coordinate."""
    hard = np.array([(k, c.start, m, c.dim) for k, c, m in scene.hard], np.int64)
    owner = np.full((scene.n, 2), -1, np.int64)
    for _, start, m, dim in hard:
        first = start + dim * np.arange(m)
        owner[start : start + m * dim, 0] = np.repeat(first, dim)
        owner[start : start + m * dim, 1] = dim
    return hard, np.concatenate([scene.radii[k] for k in hard[:, 0]]), owner


def packs(scene) -> bool:
    """Whether kernels.pbd_packed takes the scene: hard particles of one family, each constraint
    besides on one of them."""
    if len(scene.hard) != 1 or not all(
        isinstance(c, Affine) or c is scene.hard[0][1] for c in scene.families
    ):
        return False
    _, c, m = scene.hard[0]
    owner = scene.cols // c.dim
    return (
        c.start == 0
        and m * c.dim == scene.n
        and bool(np.all(owner == np.repeat(owner[scene.ptr[:-1]], np.diff(scene.ptr))))
    )


def _first_rows(scene):
    """Families of rows, and the first row of each among all."""
    k = [k for k, c in enumerate(scene.families) if isinstance(c, Affine)]
    return k, np.cumsum([0, *(a.shape[0] for a in scene.affine)])[:-1].tolist()


def _mean_radius(scene):
    return float(np.mean(np.concatenate(list(scene.radii.values()))))


def _trajectory(case, g, loop, out, again=None):
    from nsbench.dynamics.contacts.kernels.impulse_records import cumulate

    X, R, ids, values, work, code, reached, *lists = out
    contacts, impulse = cumulate(ids, values, len(g.t))
    steps = int(g.substeps.sum())
    stats = {"steps": steps, "h": g.h, "drift_calls": steps, "projections": int(work), "loop": loop}
    if lists:
        stats |= {"rebuilds": int(lists[0]), "contacts_peak": int(lists[1])}
    status = Status()
    if code == 1:
        impulse[~np.isfinite(X[:, 0])] = np.nan
        status = classify_divergence(g, X, reached, again)
    elif code == 2:
        status = Status(
            "degenerate",
            "Coincident centres: the contact has no normal; they were parted along the first axis.",
        )
    lam = last_steps(case.t, g, impulse)
    if not g.aligned:
        X, R, impulse = (sample(case.t, g.t, v) for v in (X, R, impulse))
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
        resolution=Resolution(step=g.h, rule="explicit"),
    )


SOLVER = PBD
