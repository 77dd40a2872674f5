"""A relay that drives an oscillator, written as a linear complementarity system.

    x' = A x - B s,   s in Sgn(C x),   A = [[0,1,0],[0,0,1],[0,-3,-2]],   B = e3,   C = e1

With y = C x = y+ - y- the sign is complementary to both parts: 0 <= 1 - s _|_ y+ >= 0 and 0 <= 1 + s _|_ y- >= 0. So
lam = (1 - s, y-), w = (y+, 1 + s) = (C x + lam2, 2 - lam1): D = [[0, 1], [-1, 0]], q = (0, 2), and
x' = A x + B lam1 - B. The feedback meets the integrator x1 two derivatives later, nothing slides (C B = C A B = 0).
Exact: while s is constant, y = x1' solves y'' + 2 y' + 3 y = -s, so y = -s/3 + Re(c e^(mu tau)), mu = -1 + sqrt(2) i,
and x1 and its integral (lam2 is -x1 while x1 < 0) follow by integration. Switches are zeros of x1, by bisection to
rounding. What it is for: switching times move with every step, so pairwise orders are erratic: fits need many h.
"""
import numpy as np

from nsbench import LCS, Case

MU = -1.0 + np.sqrt(2.0) * 1j


def along(tau, x, s):
    """x (3,) and the integral of x1 after the time tau with the sign s; tau (k,) or a number, x (3,) or (3, k)."""
    a = x[1] + s / 3.0
    c = a - 1j * (x[2] + a) / np.sqrt(2.0)
    e = np.exp(MU * tau)
    grow = np.expm1(MU * tau) / MU                            # int e^(mu tau): no cancellation for small tau
    x1 = x[0] - s * tau / 3.0 + np.real(c * grow)
    total = x[0] * tau - s * tau**2 / 6.0 + np.real(c * (grow - tau) / MU)
    return np.array([x1, -s / 3.0 + np.real(c * e), np.real(c * MU * e)]), total


def switch(x, s, reach):
    """First time after which s x1 < 0, at most `reach`; None if there is none."""
    grid = np.linspace(0.0, reach, 4001)[1:]
    below = np.flatnonzero(s * along(grid, x, s)[0][0] < 0.0)
    if not below.size:
        return None
    low, high = (grid[below[0] - 1] if below[0] else 0.0), grid[below[0]]
    for _ in range(100):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if s * along(mid, x, s)[0][0] > 0.0 else (low, mid)
    return high


def make(x1: float = 0.3, T: float = 20.0) -> Case:
    """x1: start (x1, 0, 0), not zero; T: end."""
    if not (x1 != 0 and np.isfinite(x1)):
        raise ValueError(f"x1 is {x1!r}; a number other than zero is needed")
    if not T > 0:
        raise ValueError(f"T is {T!r}; a positive number is needed")
    times, states, signs, sums = [0.0], [np.array([x1, 0.0, 0.0])], [np.sign(x1)], [np.zeros(2)]
    while (length := switch(states[-1], signs[-1], T - times[-1])) is not None:
        x, total = along(length, states[-1], signs[-1])
        off = signs[-1] < 0
        sums.append(sums[-1] + off * np.array([2.0 * length, -total]))
        times.append(times[-1] + length)
        states.append(np.array([0.0, x[1], x[2]]))
        signs.append(-signs[-1])
    times, states, signs, sums = map(np.array, (times, states, signs, sums))

    def arcs(t):
        k = np.searchsorted(times, t, side="right") - 1
        return k, t - times[k], *along(t - times[k], states[k].T, signs[k])

    def exact(t):
        return arcs(t)[2].T

    def exact_impulse(t):
        k, tau, _, total = arcs(t)
        return sums[k] + np.where(signs[k] < 0, 1.0, 0.0)[:, None] * np.stack((2.0 * tau, -total), axis=1)

    return Case(
        name="relay_lcs",
        problem=LCS(A=[[0, 1, 0], [0, 0, 1], [0, -3, -2]], B=[[0, 0], [0, 0], [1, 0]], C=[[1, 0, 0], [0, 0, 0]],
                    D=[[0, 1], [-1, 0]], u=lambda xp: lambda t: xp.array([0.0, 0.0, -1.0]),
                    q=lambda xp: lambda t: xp.array([0.0, 2.0])),
        x0=np.array([x1, 0.0, 0.0]),
        t=np.linspace(0.0, T, 201),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(times[1:]),
        also=("theta[theta=0.5]",),
        tags=("lcs",),
    )
