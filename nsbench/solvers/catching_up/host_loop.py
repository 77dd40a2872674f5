"""Time loop of the catching-up scheme in Python.

It serves the library backends, Smooth families, and the nonlinear projection

    min |y - z|^2    subject to    g(y) >= 0,

which is solved by successive linearisation (SQP with the identity as Hessian).
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR, ConstraintSet
from nsbench.qp.projection import Answer, SparseRows
from nsbench.solvers.base import Grid
from nsbench.solvers.catching_up.outcome import Outcome
from nsbench.solvers.catching_up.qp_backends import BACKENDS, residual

# steps that did not converge, after which the run ends: each takes MAX_LINEARISATIONS programs
MAX_UNSETTLED_STEPS = 20
MAX_LINEARISATIONS = 300  # each reduces the error by a factor of about mu times the curvature
SHORTEST_STEP = 1 / 64  # part of an SQP step that is taken at least, where steps oscillate
# change of y over the size of the state, below which the linearisation has converged
SETTLED = 1e-12


class _List:
    """Candidates near a point, with the certificate that the pairs left out do not matter.

    A pair left out cannot be violated while no particle is farther than skin / 2 from `base`.
    """

    def __init__(self, scene, x, skin, t, old=None, mu=None):
        self.near = scene.near(x, skin, t)
        self.base = x.copy()
        self.skin = skin
        self.mu = np.zeros(len(self.near))
        self.places = scene.layout(self.near)
        # the pattern of the gradients is the same as long as the list
        row, cols, _ = scene.gradient_entries(t, x, self.near)
        self.rows = SparseRows(row, cols, (len(self.near), scene.n))
        self.touching = np.isin(self.near.kind, (PAIR, ANCHOR))
        self.coincident = -self.near.sign * self.near.d  # the gap of coincident centres
        self._hard = [(c.start, m, c.dim) for _, c, m in scene.hard]
        if old is not None:
            known = dict(zip(old.near.ids, mu, strict=True))
            self.mu = np.array([known.get(k, 0.0) for k in self.near.ids])

    def largest_displacements(self, x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
        """Return the largest displacements of hard particles, base -> x -> y and x -> y alone.

        x, y (n,): states; both results are lengths.
        """
        far = last = 0.0
        for start, m, dim in self._hard:
            part = slice(start, start + m * dim)
            lengths = [
                np.sqrt((v[part].reshape(m, dim) ** 2).sum(1)) for v in (x - self.base, y - x)
            ]
            far = max(far, (lengths[0] + lengths[1]).max())
            last = max(last, lengths[1].max())
        return far, last


class HostLoop:
    """One run of the catching-up scheme in Python."""

    def __init__(
        self,
        case: Case,
        scene: ConstraintSet,
        g: Grid,
        x0: np.ndarray,
        backend: str,
        nonlinear: bool,
        reach: float,
        eps: float | None,
        max_iter: int | None,
    ):
        from nsbench.compilation.factories import as_numpy

        self.t0 = float(case.t[0])
        self.scene = scene
        self.grid = g
        self.x0 = x0
        self.reach = reach
        self.f = as_numpy(case.problem.drift)
        self.nonlinear = nonlinear
        self.make = lambda: BACKENDS[backend](eps, max_iter)

    def run(self) -> Outcome:
        with np.errstate(all="ignore"):
            return self._march()

    def _march(self):
        t = self.grid.t
        substeps = self.grid.substeps
        self.backend = self.make()
        self.stats = {"qp_solves": 0, "inner_iterations": 0, "rebuilds": 1, "limits": 0, "ties": 0}
        x = self.x0.copy()
        reac = np.zeros(self.x0.size)
        self.list = _List(self.scene, x, self.reach, self.t0)
        self.peak = len(self.list.near)
        X = np.full((len(t), x.size), np.nan)
        R = np.full((len(t), x.size), np.nan)
        X[0] = x
        R[0] = reac
        self.records = []
        self.unsettled = 0
        worst = 0.0
        when = self.t0
        for k in range(len(t) - 1):
            h = (t[k + 1] - t[k]) / substeps[k]
            for s in range(substeps[k]):
                now = t[k] + s * h
                after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
                z = x + h * np.asarray(self.f(now, x), float)
                if not _finite(z):
                    return self._result(X, R, worst, when, "nan", now)
                code, mu, y, kkt = self._step(after, x, z, h)
                if not kkt <= worst:
                    worst = kkt
                    when = now
                if code == "infeasible":
                    return self._result(X, R, worst, when, code, now)
                if self.unsettled >= MAX_UNSETTLED_STEPS:
                    return self._result(X, R, worst, when, "unsettled", now)
                if not _finite(y):
                    return self._result(X, R, worst, when, "nan", now)
                reac += y - z
                x = y
                self._record(k + 1, mu)
            X[k + 1] = x
            R[k + 1] = reac
        return self._result(X, R, worst, when, "ok", t[-1])

    def _step(self, after, x, z, h):
        """Solve the step from x to the time `after`, again over a longer list where needed.

        z (n,): the Euler step; h: its length. Returns code, mu, y and the KKT residual.
        """
        from nsbench.solvers.catching_up.kernels.list_certificate import next_skin

        while True:
            code, mu, y, kkt, far, last = (self._nonlinear if self.nonlinear else self._linear)(
                after, x, z, h
            )
            if code == "infeasible" or not 2.0 * far > self.list.skin:
                self.list.mu = mu
                return code, mu, y, kkt
            skin = next_skin.py_func(self.reach, 2.0 * last)
            self.list = _List(self.scene, x, skin, after, self.list, mu)
            self.stats["rebuilds"] += 1
            self.peak = max(self.peak, len(self.list.near))

    def _linear(self, after, x, z, h):
        g, q, G = self._linearise(after, x, z)
        a = self._solve(G, q, h, self.list.mu)
        self._ties(g, a.mu)
        return (
            a.code,
            a.mu,
            z + a.d,
            residual(G, q + G @ a.d, a.mu, a.d),
            *self.list.largest_displacements(x, z + a.d),
        )

    def _nonlinear(self, after, x, z, h):
        """Solve min |y - z|^2 subject to g(y) >= 0 by SQP with step halving.

        Returns code, mu, y, the KKT residual, and the largest displacements from the base of the
        list and from x.
        """
        y = x
        mu = self.list.mu
        far = 0.0
        last = 0.0
        fraction = 1.0
        last_change = np.inf
        scale = max(1.0, float(np.abs(z).max()))
        # SQP: linearise g at y, solve the projection, repeat to a fixed point. Links under tension
        # make full steps oscillate; the step is halved when it does not shrink by 10 %.
        for _ in range(MAX_LINEARISATIONS):
            g, q, G = self._linearise(after, y, z)
            a = self._solve(G, q, h, mu)
            new = z + a.d
            mu = a.mu
            reach = self.list.largest_displacements(y, new)
            far = max(far, reach[0])
            last = max(last, float(self.list.largest_displacements(x, new)[1]), reach[1])
            change = float(np.abs(new - y).max())
            if a.code == "infeasible" or 2.0 * far > self.list.skin:
                return a.code, mu, new, np.nan, far, last
            if change <= SETTLED * scale or not np.isfinite(change):
                y = new
                break
            if change > 0.9 * last_change:
                fraction = max(0.5 * fraction, SHORTEST_STEP)
            last_change = change
            y = y + fraction * (new - y)
        else:
            self.stats["limits"] += 1
            self.unsettled += 1
        w, _, G = self._linearise(after, y, y)
        self._ties(g, mu)
        return "solved", mu, y, residual(G, w, mu, y - z), far, last

    def _ties(self, g, mu):
        """Count impulses between coincident centres, which have no direction."""
        self.stats["ties"] += int(
            np.count_nonzero(self.list.touching & (mu > 0.0) & (g == self.list.coincident))
        )

    def _linearise(self, after, x, z):
        near = self.list.near
        places = self.list.places
        g = self.scene.gaps(after, x, near, places)
        G = self.list.rows.fill(self.scene.gradient_values(after, x, near, places))
        return g, g + G @ (z - x), G

    def _solve(self, G, q, h, mu) -> Answer:
        if np.all(q >= 0.0):  # no constraint is violated: d = 0 solves it
            return Answer(np.zeros(q.size), np.zeros(G.shape[1]), "solved", 0)
        a = self.backend(G, q, h, self.list, mu)
        self.stats["qp_solves"] += 1
        self.stats["inner_iterations"] += a.iterations
        self.stats["limits"] += a.code == "maxiter"
        return a

    def _record(self, k, mu):
        on = np.flatnonzero(mu)
        if not on.size:
            return
        near = self.list.near
        ids = np.stack([np.full(on.size, k), near.family[on], near.i[on], near.j[on]], axis=1)
        self.records.append((ids, mu[on]))

    def _result(self, X, R, worst, when, code, reached):
        ids = np.concatenate([r[0] for r in self.records] or [np.empty((0, 4), np.int64)])
        values = np.concatenate([r[1] for r in self.records] or [np.empty(0)])
        stats = {**self.stats, "contacts_peak": self.peak, "setups": self.backend.setups}
        return Outcome(X, R, ids, values, stats, worst, when, code, reached)


def _finite(x):
    return bool(np.all(np.abs(x) < 1e150))
