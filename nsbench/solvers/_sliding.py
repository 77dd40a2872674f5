"""The motion of a Filippov system in one mode: weights that keep it on its surfaces, and the projection onto them.

A mode p (d,) holds +1 or -1 where the state is beside surface i, 0 where it slides on it.
"""
from __future__ import annotations

from itertools import product

import numpy as np

TINY = 1e-30          # imaginary step: its square vanishes against 1, so the derivative has no truncation error
EPS = np.finfo(float).eps


class Motion:
    """x' = F(t, x, s) with the signs s of a mode; the work of one run, no state but counters.

    field(t, x, s) -> (n,), switch(t, x) -> (d,): numpy. `along(t, x, dt, dx)` -> (d,) is the derivative of the
    switch functions in the direction (dt, dx), exact to rounding: by a complex step while that agrees with
    differences, else by JAX.
    """
    def __init__(self, problem, t0: float, x0: np.ndarray):
        self.field, self.switch, self._factory = problem.field(np), problem.switch(np), problem.switch
        self.n, self.d = x0.size, len(self.switch(t0, x0))
        self.along, self.newton, self.calls = self._complex, 0, 0
        self.trust(t0, x0)

    def _complex(self, t, x, dt, dx):
        return np.imag(self.switch(t + TINY * 1j * dt, x + TINY * 1j * dx)) / TINY

    def trust(self, t: float, x: np.ndarray) -> None:
        """Turn from complex steps to JAX if the switch does not continue to complex numbers (abs, sorting) near x."""
        if self.along != self._complex:
            return
        try:
            good = all(self._agrees(t, x, dt, dx) for dt, dx in ((1.0, np.zeros(self.n)),
                                                                 *((0.0, e) for e in np.eye(self.n))))
        except (TypeError, ValueError, np.exceptions.ComplexWarning):
            good = False
        if not good:
            self.along = self._by_jax(t, x)

    def _agrees(self, t, x, dt, dx) -> bool:
        import warnings
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            exact = self._complex(t, x, dt, dx)
            h = 1e-6 * (1.0 + np.abs(x).max())
            rough = (self.switch(t + h * dt, x + h * dx) - self.switch(t - h * dt, x - h * dx)) / (2 * h)
        return bool(np.all(np.abs(exact - rough) <= 1e-4 * (1.0 + np.abs(rough))))

    def _by_jax(self, t, x):
        from nsbench.compile import jax_function
        c = jax_function(self._factory)
        import jax
        slope = jax.jit(lambda t, x, dt, dx: jax.jvp(c, (t, x), (dt, dx))[1])
        try:
            slope(float(t), x, 1.0, x)                          # compiles
        except (TypeError, ValueError, AttributeError, NotImplementedError) as e:
            reason = str(e).strip().splitlines()[0]
            raise ValueError("the switch functions can be differentiated neither by complex steps nor by JAX: "
                             f"{reason}") from None
        return lambda t, x, dt, dx: np.asarray(slope(float(t), x, float(dt), dx))

    def gradients(self, t, x, rows) -> np.ndarray:
        """(len(rows), n) gradients of the switch functions in x."""
        return np.array([self.along(t, x, 0.0, e)[rows] for e in np.eye(self.n)]).T

    def velocity(self, t, x, p, guess):
        """(F, s): the velocity in mode p and its signs; s of a sliding surface solves c_i' = 0, NaN if nothing does.

        F is multilinear in s; continued beyond |s_i| = 1, so that the exit of a sliding arc is a smooth event.
        guess (d,): where Newton's method starts (several surfaces). Source: Filippov 1988; Alexander & Seidman 1998.
        """
        on = np.flatnonzero(p == 0)
        s = p.astype(float)
        if not on.size:
            self.calls += 1
            return self.field(t, x, s), s
        corners = np.empty((2,) * on.size + (self.n,))
        rates = np.empty((2,) * on.size + (on.size,))
        for code in product((0, 1), repeat=on.size):
            s[on] = 1.0 - 2.0 * np.array(code)                   # index 0 is the positive side
            corners[code] = self.field(t, x, s)
            rates[code] = self.along(t, x, 1.0, corners[code])[on]
        self.calls += 2**on.size
        s[on] = self._signs(rates, guess[on])
        return _blend(corners, s[on]), s

    def _signs(self, rates, s):
        if s.size == 1:
            plus, minus = rates[0, 0], rates[1, 0]
            with np.errstate(all="ignore"):
                return np.array([(plus + minus) / (minus - plus)])
        for _ in range(30):
            self.newton += 1
            slopes = np.array([_blend(0.5 * np.subtract(*np.moveaxis(rates, j, 0)), np.delete(s, j))
                               for j in range(s.size)]).T
            try:
                move = np.linalg.solve(slopes, _blend(rates, s))
            except np.linalg.LinAlgError:
                break
            s = s - move
            if np.abs(move).max() <= 1e-13 * (1.0 + np.abs(s).max()):
                return s
        return np.full(s.size, np.nan)

    def project(self, t, x, on):
        """The nearest point with c_i = 0 for i in `on`, to first order of the distance; x itself if it is there."""
        for _ in range(3):
            c = self.switch(t, x)[on]
            G = self.gradients(t, x, on)
            if np.all(np.abs(c) <= 4 * EPS * np.abs(G) @ np.abs(x)) or not np.all(np.isfinite(G)):
                break
            x = x - np.linalg.lstsq(G, c, rcond=None)[0]
        return x


def _blend(corners, s):
    """Multilinear interpolation: corners (2, ..., 2, n), index 0 at s = 1, index 1 at s = -1."""
    for v in s:
        corners = 0.5 * (1.0 + v) * corners[0] + 0.5 * (1.0 - v) * corners[1]
    return corners
