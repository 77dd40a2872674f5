"""Worst violation that one linearised sweep leaves: evaluation and simulated annealing.

In the worst case each contact is either projected from its largest violation u_k (active), or its
gap is just so large that it is not projected (nsbench.studies.lemma.exact_constant says why). With
q_k = sum_{l before k} a_kl c_l,

    c_k = max(0, u_k - q_k) if active, else 0,
    v'_k = -sum_{l after k} a_kl c_l - max(0, q_k - u_k).

So a worst case is an order and a set of active contacts. A is stored by rows without its diagonal:
row k has the columns cols[ptr[k]:ptr[k + 1]] with the entries vals. target: the contact whose v' is
maximised, or -1 for the sum of all positive v'.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

FIRST_STATE = np.uint64(0x9E3779B97F4A7C15)  # of the generator; no seed may give 0


@inner_kernel
def _next_random(state):
    """Advance the xorshift generator state (1,); returns a number in [0, 1)."""
    x = state[0]
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    state[0] = x
    return np.float64(x >> np.uint64(11)) / 9007199254740992.0


@inner_kernel
def _violation_left(ptr, cols, vals, u, target, order, active, c, left):
    """Sweep once; returns v' of the target, or the sum of v'. c, left (m,): corrections and -v'."""
    m = len(order)
    for k in range(m):
        c[k] = 0.0
        left[k] = 0.0
    for place in range(m):
        k = order[place]
        q = 0.0
        for e in range(ptr[k], ptr[k + 1]):
            q += vals[e] * c[cols[e]]
        left[k] = max(0.0, q - u[k])
        if active[k] and u[k] > q:
            c[k] = u[k] - q
            # contacts that were projected before are opened or closed by this one
            for e in range(ptr[k], ptr[k + 1]):
                left[cols[e]] += vals[e] * c[k]
            # those projected later take their own remainder above
    if target >= 0:
        return -left[target]
    total = 0.0
    for k in range(m):
        total += max(0.0, -left[k])
    return total


@inner_kernel
def _move(order, start, end):
    """Move the contact at place `start` to place `end`; those between shift by one."""
    k = order[start]
    step = 1 if end > start else -1
    for place in range(start, end, step):
        order[place] = order[place + step]
    order[end] = k


@inner_kernel
def evaluate(ptr, cols, vals, u, target, order, active):
    """Return v' of the target (or the sum of v') of one order and one set of active contacts."""
    c = np.zeros(len(order))
    left = np.zeros(len(order))
    return _violation_left(ptr, cols, vals, u, target, order, active, c, left)


@njit(cache=True, error_model="numpy")
def ascend_active_set(ptr, cols, vals, u, target, order, active):
    """Flip contacts, as long as one flip increases v' of the target; returns the local maximum.

    active (m,): the start, replaced by the best set.
    """
    m = len(order)
    c = np.zeros(m)
    left = np.zeros(m)
    best = _violation_left(ptr, cols, vals, u, target, order, active, c, left)
    unchanged = 0
    place = m - 1
    # coordinate ascent, from the last contact of the order to the first, round and round
    while unchanged < m:
        k = order[place]
        active[k] = not active[k]
        value = _violation_left(ptr, cols, vals, u, target, order, active, c, left)
        if value > best:
            best = value
            unchanged = 0
        else:
            active[k] = not active[k]
            unchanged += 1
        place = place - 1 if place > 0 else m - 1
    return best


@njit(cache=True, error_model="numpy")
def anneal(ptr, cols, vals, u, target, order, active, steps, heat, seed):
    """Simulated annealing over orders and active sets; returns the best value found.

    order, active (m,): the start, replaced by the best. steps: evaluations. heat: first and last
    temperature, in units of a violation. seed: of the generator.
    """
    m = len(order)
    c = np.zeros(m)
    left = np.zeros(m)
    state = np.full(1, FIRST_STATE ^ np.uint64(seed))
    for _ in range(8):
        _next_random(state)
    value = _violation_left(ptr, cols, vals, u, target, order, active, c, left)
    best = value
    best_order = order.copy()
    best_active = active.copy()
    cooling = (heat[1] / heat[0]) ** (1.0 / max(1, steps - 1))
    temperature = heat[0]
    for _ in range(steps):
        flip = _next_random(state) < 0.3
        start = int(_next_random(state) * m)
        end = int(_next_random(state) * m)
        k = order[start]
        if flip:
            active[k] = not active[k]
        else:
            _move(order, start, end)
        new = _violation_left(ptr, cols, vals, u, target, order, active, c, left)
        if new >= value or _next_random(state) < np.exp((new - value) / temperature):
            value = new
            if value > best:
                best = value
                best_order[:] = order
                best_active[:] = active
        elif flip:
            active[k] = not active[k]
        else:
            _move(order, end, start)
        temperature *= cooling
    order[:] = best_order
    active[:] = best_active
    return best


@njit(cache=True, error_model="numpy")
def worst_of_order(ptr, cols, vals, order):
    """Return the largest v' over all targets found by coordinate ascent for a fixed order, u = 1.

    Each target starts from all contacts active and from none.
    """
    m = len(order)
    u = np.ones(m)
    best = 0.0
    for target in range(m):
        for start in (False, True):
            active = np.full(m, start)
            value = ascend_active_set(ptr, cols, vals, u, target, order, active)
            best = max(best, value)
    return best
