"""Cubic polynomials of a step, and quadrature over the quarters of an interval."""

import numpy as np

from nsbench.compilation.decorators import inner_kernel

QUARTERS = np.arange(5) / 4.0  # of an interval, ends included
# of an interval: where a drift that oscillates from quarter to quarter shows itself
HIDDEN = np.array([0.137, 0.571])
# (2, 5): the polynomial through values at the quarters, at HIDDEN
HIDDEN_WEIGHTS = np.array(
    [[np.prod([(w - b) / (a - b) for b in QUARTERS if b != a]) for a in QUARTERS] for w in HIDDEN]
)
BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
BEYOND_SIMPSON = BOOLE - np.array([1.0, 0.0, 4.0, 0.0, 1.0]) / 6.0


@inner_kernel
def norm(v: np.ndarray) -> float:
    """Return the 2-norm of v (n,)."""
    s = 0.0
    for c in v:
        s += c * c
    return np.sqrt(s)


@inner_kernel
def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Return the 2-norm of a - b, both (n,)."""
    s = 0.0
    for c in range(len(a)):
        s += (a[c] - b[c]) * (a[c] - b[c])
    return np.sqrt(s)


@inner_kernel
def fill_scaled(a: np.ndarray, factor: float, out: np.ndarray) -> None:
    """Fill out (n,) with a (n,) times a factor."""
    for c in range(len(a)):
        out[c] = factor * a[c]


@inner_kernel
def fill_moved(y: np.ndarray, h: float, v: np.ndarray, out: np.ndarray) -> None:
    """Fill out (n,) with y + h v."""
    for c in range(len(y)):
        out[c] = y[c] + h * v[c]


@inner_kernel
def fill_runge_kutta(y: np.ndarray, h: float, slopes: np.ndarray, out: np.ndarray) -> None:
    """Fill out (n,) with the end of a classical Runge-Kutta step h from y with the slopes of its
    four stages, the first rows of `slopes`."""
    for c in range(len(y)):
        inner = slopes[1, c] + slopes[2, c]
        out[c] = y[c] + h / 6.0 * (slopes[0, c] + 2.0 * inner + slopes[3, c])


@inner_kernel
def fill_powers(
    y: np.ndarray,
    h: float,
    v: np.ndarray,
    last: np.ndarray,
    last_v: np.ndarray,
    powers: np.ndarray,
) -> None:
    """Fill powers (4, n) with the coefficients, in the part of a step h, of the cubic Hermite
    polynomial from y with the velocity v to `last` with last_v."""
    for c in range(len(y)):
        way = last[c] - y[c]
        powers[0, c] = y[c]
        powers[1, c] = h * v[c]
        powers[2, c] = 3.0 * way - h * (2.0 * v[c] + last_v[c])
        powers[3, c] = h * (v[c] + last_v[c]) - 2.0 * way


@inner_kernel
def fill_state(powers: np.ndarray, w: float, x: np.ndarray) -> None:
    """Fill x (n,) with the value of the cubic with the coefficients powers (4, n) at w."""
    for c in range(len(x)):
        x[c] = powers[0, c] + w * (powers[1, c] + w * (powers[2, c] + w * powers[3, c]))


@inner_kernel
def fill_slope(powers: np.ndarray, w: float, h: float, v: np.ndarray) -> None:
    """Fill v (n,) with the derivative in time of the same cubic at the part w of a step h."""
    for c in range(len(v)):
        v[c] = (powers[1, c] + w * (2.0 * powers[2, c] + 3.0 * w * powers[3, c])) / h


@inner_kernel
def fill_controls(
    first: np.ndarray,
    last: np.ndarray,
    rise: np.ndarray,
    fall: np.ndarray,
    middle: np.ndarray,
    P: np.ndarray,
) -> None:
    """Fill P (4, n) with the Bezier control points of the cubic from `first` to `last` with the
    derivatives rise and fall, all (n,), in its part, moved so that its middle is `middle`."""
    for c in range(len(first)):
        P[0, c] = first[c]
        P[1, c] = first[c] + rise[c] / 3.0
        P[2, c] = last[c] - fall[c] / 3.0
        P[3, c] = last[c]
        off = middle[c] - (P[0, c] + 3.0 * (P[1, c] + P[2, c]) + P[3, c]) / 8.0
        for a in range(4):
            P[a, c] += off


@inner_kernel
def fill_weighted(weights: np.ndarray, F: np.ndarray, out: np.ndarray) -> None:
    """Fill out (n,) with the sum of the values F (5, n) at the quarters, times weights (5,)."""
    for c in range(len(out)):
        s = 0.0
        for e in range(len(weights)):
            s += weights[e] * F[e, c]
        out[c] = s


@inner_kernel
def upper_mean(sizes: np.ndarray) -> float:
    """Return an upper estimate of the mean of a size from its values (5,) at the quarters: Boole's
    rule, and how far it is from Simpson's."""
    mean = 0.0
    off = 0.0
    for e in range(len(sizes)):
        mean += BOOLE[e] * sizes[e]
        off += BEYOND_SIMPSON[e] * sizes[e]
    return mean + abs(off)


@inner_kernel
def turned(S: np.ndarray) -> float:
    """Return the sum of |S[e + 1] - S[e]| over the quarters and entries of S (5, n)."""
    total = 0.0
    for e in range(len(S) - 1):
        for c in range(S.shape[1]):
            total += abs(S[e + 1, c] - S[e, c])
    return total
