"""Certificate of a neighbour list: the skin with which no pair that it leaves out can matter.

A pair left out was farther apart than D + skin when the list was built, D its distance of contact.
Since gaps of discs are convex, its linearised gap after a step x -> y is at least

    d - D - |U_i - U_j| - |V_i - V_j|,    U = x - base, V = y - x, d > D + skin,

so that 2 max |U| + 2 max |V| is skin enough. Particles that are drawn together move much farther
than neighbours move apart: displacements are split into a similarity, which is fitted, and a rest,

    U_i = u + s (base_i - c) + r_i,    |U_i - U_j| <= |s| d + 2 max |r|,

and V alike, over the distance at x. Then skin >= (alpha D + beta) / (1 - alpha) suffices, with
alpha = |s| + |s'| (1 + |s|) < 1 and beta = 2 max |r| (1 + |s'|) + 2 max |r'|, primes for V.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

# skin of a list over what a step needs: it should outlive its own step, unless it were longer than
# WIDE times the least skin, which is a particle or so; then it must last this step
OVER_STEP = 4.0
OVER_LONG_STEP = 1.25
WIDE = 8.0
STRONGEST = 0.5  # alpha: of a stronger similarity little is gained
ROUNDING = 1e-9


@njit(cache=True, error_model="numpy")
def next_skin(reach: float, needed: float) -> float:
    """Return the skin of the next list, from the least one and the skin that a step needs.

    The length of a list, and what it costs to build and to search, grows as the square of a skin
    beyond the particles' own size.
    """
    return max(reach, min(OVER_STEP * needed, max(OVER_LONG_STEP * needed, WIDE * reach)))


@inner_kernel
def _farthest(base, x, start, n, dim):
    """Return max |x - base| of n particles."""
    far = 0.0
    for i in range(n):
        u = 0.0
        for c in range(start + i * dim, start + (i + 1) * dim):
            u += (x[c] - base[c]) ** 2
        far = max(far, u)
    return np.sqrt(far)


@inner_kernel
def _similarity(base, x, start, n, dim):
    """Fit x - base of n particles by a similarity; return its |s| and max |r|."""
    centre = np.zeros(3)
    mean = np.zeros(3)
    for i in range(n):
        for c in range(dim):
            p = base[start + i * dim + c]
            centre[c] += p / n
            mean[c] += (x[start + i * dim + c] - p) / n
    product = 0.0
    square = 0.0
    for i in range(n):
        for c in range(dim):
            p = base[start + i * dim + c]
            product += (x[start + i * dim + c] - p - mean[c]) * (p - centre[c])
            square += (p - centre[c]) ** 2
    s = product / square if square > 0.0 else 0.0
    rest = 0.0
    for i in range(n):
        r = 0.0
        for c in range(dim):
            p = base[start + i * dim + c]
            r += (x[start + i * dim + c] - p - mean[c] - s * (p - centre[c])) ** 2
        rest = max(rest, r)
    return abs(s), np.sqrt(rest)


@inner_kernel
def needed_skins(
    base: np.ndarray, x: np.ndarray, y: np.ndarray, hard: np.ndarray, radii: np.ndarray, skin: float
) -> tuple[float, float]:
    """Return the skins that a list needs for the step x -> y: of one built at base, and at x.

    base, x, y (n,): states; hard (families, 4), radii: see candidates.gather. Similarities are
    fitted only where a list with this skin would be too short without them.
    """
    since = 0.0
    alone = 0.0
    at = 0
    for u in range(hard.shape[0]):
        _, start, n, dim = hard[u]
        widest = 0.0
        for i in range(n):
            widest = max(widest, 2.0 * radii[at + i])
        at += n
        far = 2.0 * _farthest(base, x, start, n, dim)
        last = 2.0 * _farthest(x, y, start, n, dim)
        far += last
        if far > skin and n > 1:
            s, r = _similarity(base, x, start, n, dim)
            t, q = _similarity(x, y, start, n, dim)
            far = min(far, _skin(s + t * (1.0 + s), 2.0 * (r * (1.0 + t) + q), widest))
            last = min(last, _skin(t, 2.0 * q, widest))
        since = max(since, far)
        alone = max(alone, last)
    return since, alone


@inner_kernel
def _skin(alpha, beta, widest):
    """Return the skin that suffices by similarities, infinite where they are too strong."""
    if alpha > STRONGEST:
        return np.inf
    return (alpha * widest + beta) / (1.0 - alpha) * (1.0 + ROUNDING)
