"""The event-driven method for hard discs as one would write it: SciPy's DOP853 with two events, all
pairs, NNLS.

A second method beside nsbench.solvers.event_driven.method, on discs and walls of `Complementarity`
cases that stand still. It shares nothing with it: gaps and gradients are numpy expressions over all
pairs, the velocity problem is a non-negative least-squares problem (min |f + G^T lam|, lam >= 0,
has the complementarity conditions as its own), solved a little ahead of the event, dense output
finds the events, and there is no list of neighbours.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import nnls

from nsbench import Affine, Distance

TOUCHING = 1e-9
AHEAD = 1e-6
ZERO = 1e-9
FAINT = 1e-11


class Plain:
    def __init__(self, case):
        self.f = case.problem.drift(np)
        self.n = case.n
        self.A = np.zeros((0, case.n))
        self.b = np.zeros(0)
        self.d = None
        self.dim = 2
        for c in case.problem.constraints:
            if isinstance(c, Affine) and not c.moving:
                dense = np.zeros(c.shape)
                dense[np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)), c.indices] = c.data
                self.A = np.vstack((self.A, dense))
                self.b = np.append(self.b, c.b)
            elif (
                isinstance(c, Distance)
                and c.all_pairs
                and c.radii is None
                and self.d is None
                and c.count is None
            ):
                self.d = float(c.d)
                self.dim = c.dim
                self.i, self.j = np.triu_indices(c.particles(case.n), 1)
            else:
                raise NotImplementedError(
                    "plain_event_driven knows equal hard discs and walls at rest"
                )

    def gaps(self, x):
        g = self.A @ x + self.b
        if self.d is None:
            return g
        p = x.reshape(-1, self.dim)
        return np.append(g, np.sqrt(((p[self.i] - p[self.j]) ** 2).sum(axis=1)) - self.d)

    def gradients(self, x, which):
        """(m, n) of the constraints `which`."""
        G = np.zeros((len(which), self.n))
        rows = len(self.b)
        for r, k in enumerate(which):
            if k < rows:
                G[r] = self.A[k]
                continue
            i = self.i[k - rows] * self.dim
            j = self.j[k - rows] * self.dim
            u = x[i : i + self.dim] - x[j : j + self.dim]
            u = u / np.sqrt(u @ u)
            G[r, i : i + self.dim] = u
            G[r, j : j + self.dim] = -u
        return G

    def held(self, t, x, active):
        f = self.f(t, x)
        if not len(active):
            return f, np.empty(0)
        G = self.gradients(x, active)
        lam = np.linalg.solve(G @ G.T, -(G @ f))
        return f + G.T @ lam, lam

    def velocity(self, t, x, closed):
        G = self.gradients(x, closed)
        f = self.f(t, x)
        lam = nnls(G.T, -f, maxiter=100 * len(closed))[0] if len(closed) else np.empty(0)
        return f + G.T @ lam, lam

    def choose(self, t, x):
        """The contacts that carry load a little later."""
        closed = np.flatnonzero(self.gaps(x) < TOUCHING)
        v, _ = self.velocity(t, x, closed)
        half, _ = self.velocity(t + AHEAD / 2, x + AHEAD / 2 * v, closed)
        _, lam = self.velocity(t + AHEAD, x + AHEAD * half, closed)
        return closed[lam > FAINT]

    def project(self, x, active):
        for _ in range(3 if len(active) else 0):
            G = self.gradients(x, active)
            x = x - G.T @ np.linalg.solve(G @ G.T, self.gaps(x)[active])
        return x


def run(case, tol=1e-10):
    """(X, times): states at case.t and the times at which the set of loaded contacts changed."""
    s = Plain(case)
    t = float(case.t[0])
    x = np.array(case.x0, float)
    T = float(case.t[-1])
    X = np.empty((len(case.t), s.n))
    done = 1
    times = []
    X[0], active = x, s.choose(t, x)
    while t < T:
        opened = np.ones(len(s.gaps(x)), bool)
        opened[active] = False
        opened[s.gaps(x) < ZERO] = False  # closed without load: seen again at the next event

        def gap(t, y, opened=opened):
            return s.gaps(y)[opened].min(initial=1.0)

        def load(t, y, active=active):
            return s.held(t, y, active)[1].min(initial=1.0) + 1e-13

        gap.terminal = load.terminal = True
        gap.direction = load.direction = -1
        part = solve_ivp(
            lambda t, y, active=active: s.held(t, y, active)[0],
            (t, T),
            x,
            "DOP853",
            rtol=tol,
            atol=tol,
            events=(gap, load),
            dense_output=True,
        )
        while done < len(case.t) and case.t[done] <= part.t[-1]:
            X[done] = part.sol(case.t[done])
            done += 1
        t = part.t[-1]
        x = part.y[:, -1]
        if part.status == 1:
            x = s.project(x, active)
            active = s.choose(t, x)
            x = s.project(x, active)
            times.append(t)
    return X, np.array(times)
