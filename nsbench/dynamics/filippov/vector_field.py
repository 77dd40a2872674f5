"""Velocity of a Filippov system in one mode: sliding signs, margins, and projection onto surfaces.

A mode p (d,) holds +1 or -1 where the state is on that side of surface i, 0 where it slides on it,
and FREE where it lies on it and both sides have the same field: nothing constrains it there, and
its sign, which no motion determines, is taken as 0. Signs s of sliding surfaces solve c_i' = 0
along the field that is multilinear in s (Filippov 1988; Alexander & Seidman 1998).
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from nsbench.case.scale import size_text, time_text
from nsbench.compilation.factories import as_jax, as_numpy
from nsbench.problem import Filippov
from nsbench.trajectory import Status

# imaginary step: its square vanishes against 1, so the derivative has no truncation error
COMPLEX_STEP = 1e-30
EPS = np.finfo(float).eps
FREE = 2
# relative difference below which two fields are the same but for rounding
SAME_FIELD = 1e-14
# tolerances of the run by which a state may miss the surface that it reaches: the claim of
# event_driven
MAX_TOLERANCES_OFF = 100.0
# starts of Newton's method in each sign, where all solutions are searched for
NEWTON_STARTS = (-0.8, 0.0, 0.8)
MAX_NEWTON_ITERATIONS = 30
MAX_PROJECTIONS = 3


class FilippovVectorField:
    """x' = F(t, x, s) with the signs s of a mode; no state but counters of its work.

    field(t, x, s) -> (n,), switch(t, x) -> (d,): numpy. along(t, x, dt, dx) -> (d,) is the
    derivative of the switch functions in the direction (dt, dx), exact to rounding: by a complex
    step while that agrees with differences, else by JAX. newton, calls: iterations and evaluations
    of the field so far.
    """

    def __init__(self, problem: Filippov, t0: float, x0: np.ndarray):
        self.field = as_numpy(problem.field)
        self.switch = as_numpy(problem.switch)
        self._factory = problem.switch
        self.n = x0.size
        self.d = len(self.switch(t0, x0))
        self.along = self._complex
        self.newton = 0
        self.calls = 0
        self.check_complex_step(t0, x0)

    def _complex(self, t, x, dt, dx):
        """Differentiate the switch functions in the direction (dt, dx) by a complex step."""
        return (
            np.imag(self.switch(t + COMPLEX_STEP * 1j * dt, x + COMPLEX_STEP * 1j * dx))
            / COMPLEX_STEP
        )

    def check_complex_step(self, t: float, x: np.ndarray) -> None:
        """Change from complex steps to JAX if the switch has no analytic continuation near x (n,).

        As with abs or sorting. Raises ValueError if JAX cannot differentiate it either.
        """
        if self.along != self._complex:
            return
        try:
            agrees = self._agrees(t, x)
        except (TypeError, ValueError, np.exceptions.ComplexWarning):
            agrees = False
        if not agrees:
            self.along = self._by_jax(t, x)

    def _agrees(self, t, x) -> bool:
        """Does the complex step agree with central differences in every direction?"""
        import warnings

        directions = ((1.0, np.zeros(self.n)), *((0.0, e) for e in np.eye(self.n)))

        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            exact = np.array([self._complex(t, x, dt, dx) for dt, dx in directions])
            h = 1e-6 * (1.0 + np.abs(x).max())
            rough = [
                self.switch(t + h * dt, x + h * dx) - self.switch(t - h * dt, x - h * dx)
                for dt, dx in directions
            ]
            rough = np.array(rough) / (2 * h)
            # in units of each switch: its largest slope, and what is left of its value by rounding
            size = np.abs(rough).max(axis=0) + np.abs(self.switch(t, x))
        return bool(np.all(np.abs(exact - rough) <= 1e-4 * size))

    def _by_jax(self, t, x):
        """Differentiate the switch functions by JAX; raise ValueError if that fails.

        Returns the function of (t, x, dt, dx).
        """
        c = as_jax(self._factory)
        import jax

        slope = jax.jit(lambda t, x, dt, dx: jax.jvp(c, (t, x), (dt, dx))[1])
        try:
            slope(float(t), x, 1.0, x)  # compiles
        except (TypeError, ValueError, AttributeError, NotImplementedError) as e:
            reason = str(e).strip().splitlines()[0]
            raise ValueError(
                "the switch functions can be differentiated neither by complex steps nor by JAX: "
                f"{reason}"
            ) from None
        return lambda t, x, dt, dx: np.asarray(slope(float(t), x, float(dt), dx))

    def gradients(self, t: float, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return (len(rows), n) the gradients of the switch functions `rows` in x."""
        return np.array([self.along(t, x, 0.0, e)[rows] for e in np.eye(self.n)]).T

    def surface_missed(
        self, t: float, x: np.ndarray, rows: np.ndarray, mode: np.ndarray, tol: float
    ) -> Status | None:
        """Return a status if a surface of `rows` that was just reached is not where the state is.

        rows (r,): of them those that the mode p (d,) has on one side. tol: of the run, in units of
        which the distance to the surface is judged. A gradient that vanishes is the reason.
        """
        rows = rows[np.abs(mode[rows]) == 1]
        slope = np.linalg.norm(self.gradients(t, x, rows), axis=1) if rows.size else np.empty(0)
        # a surface may be reached in time alone
        slope = np.maximum(slope, np.abs(self.along(t, x, 1.0, np.zeros(self.n)))[rows])
        distance = np.abs(self.switch(t, x)[rows]) / np.maximum(slope, np.finfo(float).tiny)
        if np.all(distance <= MAX_TOLERANCES_OFF * tol * (1.0 + np.abs(x).max())):
            return None
        return Status(
            "degenerate",
            f"At t = {time_text(t)} the gradient of surface {rows[distance.argmax()]} vanishes "
            "where it "
            f"is met: that is told to within {size_text(distance.max(), 1)} only.",
        )

    def velocity(
        self, t: float, x: np.ndarray, p: np.ndarray, guess: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the velocity F (n,) in mode p and its signs s (d,).

        Signs of sliding surfaces solve c_i' = 0, and are NaN if nothing does. F is multilinear in
        s and continued beyond |s_i| = 1, so that the exit of a sliding arc is a smooth event.
        guess (d,): start of Newton's method, where the mode slides on several surfaces.
        """
        s = np.where(p == FREE, 0, p).astype(float)
        on = np.flatnonzero(p == 0)
        if not on.size:
            self.calls += 1
            return self.field(t, x, s), s
        corners, rates = self._corners(t, x, s, on)
        s[on] = _ratio(*rates[:, 0]) if on.size == 1 else self._newton(corners, rates, guess[on])
        return _blend(corners, s[on]), s

    def sliding_margins(
        self, t: float, x: np.ndarray, p: np.ndarray, guess: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return 1 - s and 1 + s of the sliding surfaces of mode p, without cancellation.

        Each vanishes as the rate of one side does. guess (d,): as for `velocity`.
        """
        s = np.where(p == FREE, 0, p).astype(float)
        on = np.flatnonzero(p == 0)
        if on.size > 1:
            s = self.velocity(t, x, p, guess)[1][on]
            return 1.0 - s, 1.0 + s
        plus, minus = self._corners(t, x, s, on)[1]
        with np.errstate(all="ignore"):
            return -2.0 * plus / (minus - plus), 2.0 * minus / (minus - plus)

    def sliding_solutions(self, t: float, x: np.ndarray, p: np.ndarray) -> list:
        """Return all signs s (d,) that keep the state on its sliding surfaces; NaN: not certain.

        One surface: one solution. Two: the roots of a quadratic. More: one if F is affine in the
        signs, else what Newton's method finds from 3^k starts. |s_i| may exceed 1.
        """
        s = np.where(p == FREE, 0, p).astype(float)
        on = np.flatnonzero(p == 0)
        if on.size < 2:
            return [self.velocity(t, x, p, np.zeros(self.d))[1]]
        corners, rates = self._corners(t, x, s, on)
        if _affine(rates):
            starts = [np.zeros(on.size)]
        elif on.size == 2:
            starts = _pair(rates)
        else:
            starts = product(NEWTON_STARTS, repeat=on.size)
        out = []
        for start in starts:
            solution = s.copy()
            solution[on] = self._newton(corners, rates, np.array(start))
            if not any(
                np.array_equal(solution, q, equal_nan=True) or np.abs(solution - q).max() < 1e-9
                for q in out
            ):
                out.append(solution)
        if any(np.all(np.isfinite(q)) for q in out):
            out = [q for q in out if np.all(np.isfinite(q))]
        return out

    def sliding_stability(self, t: float, x: np.ndarray, p: np.ndarray) -> float:
        """Return how far the best motion off the sliding surfaces of mode p (d,) is from existing.

        Negative: one exists. A motion off slides on some of the surfaces, with |s_i| <= 1, and
        gains distance from the others. Where surfaces meet, it may exist besides a motion that
        stays: then the solution is not unique. In relative units, between -1 and 1.
        None exists where the rates are affine in the signs and the negative of their matrix has
        positive principal minors (Cottle, Pang & Stone 1992, theorem 3.3.7, for the box).
        """
        on = np.flatnonzero(p == 0)
        _, rates = self._corners(t, x, np.where(p == FREE, 0, p).astype(float), on)
        if _affine(rates) and _positive_minors(-_slopes(rates, np.zeros(on.size))):
            return 1.0
        best = -1.0
        for q in product((0, 1, -1), repeat=on.size):
            q = np.array(q)
            off = np.flatnonzero(q)
            sliding = np.flatnonzero(q == 0)
            if not off.size:
                continue
            part = rates[tuple(slice(None) if v == 0 else (1 - v) // 2 for v in q)]
            for s in self._sliding_signs(part[..., sliding]):
                gain = (q * _blend(part, s))[off].min()
                margin = (1.0 - np.abs(s)).min(initial=1.0)
                best = max(best, min(gain, margin)) if np.isfinite(gain + margin) else best
        return -min(best, 1.0)

    def _sliding_signs(self, rates) -> list:
        """List the signs (k,) that slide on all surfaces with the given rates (2, ..., 2, k)."""
        k = rates.shape[-1]
        if k == 0:
            return [np.empty(0)]
        if k == 1:
            return [_ratio(*rates[:, 0:1])]
        if k == 2:  # roots of the quadratic need no refinement to test for a motion
            return [np.array(q) for q in _pair(rates)[1:]]
        return [self._newton(rates, rates, np.zeros(k))]

    def _corners(self, t, x, s, on):
        """Return the fields (2, ..., 2, n) and rates (2, ..., 2, k) at the corners of the signs.

        Of the k sliding surfaces `on`; index 0 is the positive side. Of several surfaces, each rate
        is in units of its largest value.
        """
        corners = np.empty((2,) * on.size + (self.n,))
        rates = np.empty((2,) * on.size + (on.size,))
        s = s.copy()
        for code in product((0, 1), repeat=on.size):
            s[on] = 1.0 - 2.0 * np.array(code)
            corners[code] = self.field(t, x, s)
            rates[code] = self.along(t, x, 1.0, corners[code])[on]
        self.calls += 2**on.size
        if on.size > 1:  # each switch function in units of its own
            size = np.abs(rates).reshape(-1, on.size).max(axis=0)
            rates /= np.where(size > 0.0, size, 1.0)
        return corners, rates

    def _newton(self, corners, rates, s):
        """Solve rates(s) = 0 by Newton's method from s (k,); NaN where it does not converge."""
        for _ in range(MAX_NEWTON_ITERATIONS):
            self.newton += 1
            slopes = _slopes(rates, s)
            try:
                move = np.linalg.solve(slopes, _blend(rates, s))
            except np.linalg.LinAlgError:
                return _smallest(corners, rates)
            s = s - move
            if np.abs(move).max() <= 1e-13 * (1.0 + np.abs(s).max()):
                # a solution of equations that are dependent but for rounding is no solution
                return s if np.linalg.cond(slopes) < 1e12 else _smallest(corners, rates)
        return np.full(s.size, np.nan)

    def fields_agree(self, t: float, x: np.ndarray, s: np.ndarray, i: int) -> bool:
        """Are the fields on both sides of surface i the same, for the other signs s (d,)?"""
        up = s.copy()
        down = s.copy()
        up[i] = 1.0
        down[i] = -1.0
        a = self.field(t, x, up)
        b = self.field(t, x, down)
        self.calls += 2
        return bool(np.abs(a - b).max() <= SAME_FIELD * np.abs(a).max())

    def project(self, t: float, x: np.ndarray, on) -> np.ndarray:
        """Return the nearest point (n,) to x with c_i = 0 for i in `on`, by Gauss-Newton steps.

        Exact to first order of the distance; x itself if it is there.
        """
        for _ in range(MAX_PROJECTIONS):
            c = self.switch(t, x)[on]
            G = self.gradients(t, x, on)
            if np.all(np.abs(c) <= 4 * EPS * np.abs(G) @ np.abs(x)) or not np.all(np.isfinite(G)):
                break
            x = x - np.linalg.lstsq(G, c, rcond=None)[0]
        return x


def _blend(corners, s):
    """Interpolate corners (2, ..., 2, n) multilinearly: index 0 at s = 1, index 1 at s = -1."""
    for v in s:
        corners = 0.5 * (1.0 + v) * corners[0] + 0.5 * (1.0 - v) * corners[1]
    return corners


def _ratio(plus, minus):
    """Return the sign at which the rate between `plus` (s = 1) and `minus` (s = -1) vanishes."""
    with np.errstate(all="ignore"):
        return (plus + minus) / (minus - plus)


def _slopes(corners, s):
    """Return (n, k) derivatives of the multilinear interpolation in each sign."""
    return np.array(
        [
            _blend(0.5 * np.subtract(*np.moveaxis(corners, j, 0)), np.delete(s, j))
            for j in range(s.size)
        ]
    ).T


def _mixed(rates):
    """Return the second differences of the corners by pairs of signs; zero if they are affine."""
    k = rates.ndim - 1
    out = [np.zeros(1)]
    for i in range(k):
        for j in range(i):
            low = np.diff(np.diff(rates, axis=i), axis=j)
            out.append(low.ravel())
    return np.concatenate(out)


def _affine(rates) -> bool:
    """Are the rates, of size one, affine in the signs but for rounding?"""
    return bool(np.abs(_mixed(rates)).max() <= 2.0 ** rates.shape[-1] * SAME_FIELD)


def _positive_minors(M) -> bool:
    """Are all principal minors of M positive?"""
    k = len(M)
    return all(
        np.linalg.det(M[np.ix_(rows, rows)]) > 1e-9
        for size in range(1, k + 1)
        for rows in combinations(range(k), size)
    )


def _pair(rates):
    """Return starts of Newton's method for two surfaces: the origin, and the roots.

    (A + C b) + a (B + D b) = 0 has a solution a where the two vectors are parallel: a quadratic in
    b.
    """
    pp = rates[0, 0]
    pm = rates[0, 1]
    mp = rates[1, 0]
    mm = rates[1, 1]
    A = (pp + pm + mp + mm) / 4
    B = (pp + pm - mp - mm) / 4
    C = (pp - pm + mp - mm) / 4
    D = (pp - pm - mp + mm) / 4
    det = lambda u, v: u[0] * v[1] - u[1] * v[0]
    terms = [det(C, D), det(A, D) + det(C, B), det(A, B)]
    roots = np.roots(terms) if np.all(np.isfinite(terms)) else np.empty(0)
    out = [(0.0, 0.0)]
    for b in roots[np.abs(roots.imag) <= 1e-7 * (1.0 + np.abs(roots))].real:
        w = B + D * b
        out.append((float(-(w @ (A + C * b)) / (w @ w)) if w @ w > 0.0 else 0.0, float(b)))
    return [q for q in out if np.all(np.isfinite(q))]


def _smallest(corners, rates):
    """Return the least-norm signs that slide on dependent surfaces, if F is the same for all.

    For fields affine in the signs (dependent surfaces, or inputs that act alike); NaN otherwise.
    """
    k = rates.ndim - 1
    none = np.full(k, np.nan)
    zero = np.zeros(k)
    if (
        not np.all(np.isfinite(rates))
        or np.abs(_mixed(corners)).max() > 1e-12 * np.abs(corners).max()
    ):
        return none
    slopes = _slopes(rates, zero)
    F = _slopes(corners, zero)
    s = -np.linalg.lstsq(slopes, _blend(rates, zero), rcond=1e-12)[0]
    if np.abs(_blend(rates, s)).max() > 1e-12:
        return none
    _, values, V = np.linalg.svd(slopes)
    null = V[values <= 1e-12]
    return none if np.abs(F @ null.T).max(initial=0.0) > 1e-10 * np.abs(corners).max() else s
