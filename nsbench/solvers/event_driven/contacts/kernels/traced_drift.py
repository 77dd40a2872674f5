"""Taylor series of a traced drift along the motion, and the certificate of a step.

The drift f(t, x) is a program (see event_driven.filippov.program), whose operations have their
Taylor coefficients in the rows of a table, order by order with those of the constrained motion.

Certificate of a piece of a step: the drift along the polynomial path is enclosed with its first
ORDER derivatives (filippov.kernels.enclosure), and so is the polynomial that stands for it; at
NODES the two agree. So they agree in between, up to the bound on interpolation (as in
filippov.kernels.step_certificate), and no pulse of the drift hides in the step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.solvers.event_driven.filippov.kernels import opcodes as op
from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER, enclose, path
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import shifted
from nsbench.solvers.event_driven.filippov.kernels.step_certificate import (
    DEFECT,
    INTERPOLATION,
    NODES,
    SMOOTH,
    at_nodes,
    fitting_part,
    tail,
)
from nsbench.solvers.event_driven.filippov.kernels.step_to_event import PIECES, SPLIT
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import (
    coefficient,
    head,
    partner,
    point,
)

if TYPE_CHECKING:
    from nsbench.solvers.event_driven.contacts.kernels.loop_state import DriftProgram

SHORTEST = 1e-12  # part of a step: a shorter piece is not tried
REST = 1e-5  # of the unit of the state: a coordinate that is smaller is held against this


@inner_kernel
def extend_drift(m: int, t: float, program: DriftProgram, X: np.ndarray, F: np.ndarray) -> None:
    """Compute F[m], order m of the drift about the time t, from the orders 0 to m of the state X.

    X (K, n), F (K - 1, n). Orders are computed one after the other from 0.
    """
    ops = program.ops
    nums = program.nums
    C = program.table
    out = program.out
    n = out.size
    for i in range(n):
        C[i, m] = X[m, i]
    C[n, m] = 0.0
    if m == 0:
        C[n, 0] = t
    elif m == 1:
        C[n, 1] = 1.0
    # automatic differentiation: coefficient m of every operation, in their order
    for e in range(ops.shape[0]):
        code = ops[e, 0]
        row = n + 1 + e
        u = ops[e, 1]
        v = ops[e, 2]
        if code == op.COS or code == op.COSH or code == op.SECH2:
            continue
        if m > 0:
            coefficient(code, C, u, v, row, nums[e, 0], m)
            continue
        C[row, 0] = head(code, C[u, 0], C[v, 0], nums[e, 0], nums[e, 1])
        if code == op.SIN or code == op.SINH or code == op.TANH:
            C[row + 1, 0] = partner(code, C[u, 0], C[row, 0])
    for i in range(n):
        F[m, i] = C[out[i], m]


@inner_kernel
def _largest_at_nodes(Q, i, p, derivative, V):
    """Return the largest size at NODES of the polynomial Q[i], or of its derivative in s; V: work
    (1, ORDER)."""
    at_nodes(Q, i, p, derivative, V, 0)
    top = 0.0
    for k in range(ORDER):
        top = max(top, abs(V[0, k]))
    return top


@inner_kernel
def _certify_piece(start, width, whole, deg, t, local, program):
    """Return how well a piece of a step is certified, as filippov's certify_piece does.

    The step begins at t and is `whole` long; deg: order of its series in program.table; local:
    error allowed. The piece is certified if the value is >= 1. Every coordinate is held against its
    own size: a small one may move beside a large one, or beside a large drift that contacts hold.
    """
    _, _, _, out, C, Q, M, R, V, _ = program
    n = out.size
    radius = 0.5 * width
    middle = start + radius
    for i in range(n):
        shifted(C, i, deg, middle, radius, Q, i)
        shifted(C, out[i], deg - 1, middle, radius, Q, n + i)
    path(Q, n, deg, t + middle, radius, M, R)
    enclose(program.ops, program.nums, program.first, n, M, R)
    # smooth: what interpolation at the nodes can miss does not count
    margin = np.inf
    pace = 0.0
    for i in range(n):
        pace = max(pace, _largest_at_nodes(Q, i, deg, 1, V) / radius)
        size = max(_largest_at_nodes(Q, n + i, deg - 1, 0, V), (abs(Q[i, 0]) + REST) / whole)
        bound = abs(M[out[i], ORDER]) + R[out[i], ORDER] + tail(Q, n + i, deg - 1, 0)
        quotient = SMOOTH * size / (bound * INTERPOLATION)
        if not quotient >= 1.0:
            return quotient
        margin = min(margin, quotient)
    # equal at the nodes
    for i in range(n):
        at_nodes(Q, i, deg, 0, V, i)
    for k in range(ORDER):
        V[n, k] = t + start + radius * (1.0 + NODES[k])
    point(program.ops, program.nums, program.first, n, V, ORDER)
    for i in range(n):
        at_nodes(Q, n + i, deg - 1, 0, M, 0)
        for k in range(ORDER):
            f = V[out[i], k]
            off = abs(M[0, k] - f) * whole
            size = abs(Q[i, 0]) + REST + whole * abs(f)
            if not off <= DEFECT * local * size + 1e-14 * whole * pace:
                return 0.0
    return margin


@inner_kernel
def certified_length(
    h: float, deg: int, t: float, local: float, program: DriftProgram, X: np.ndarray
) -> float:
    """Return the part of a step of length h from t on which the series of order deg stands for the
    drift; 0.0 if there is none.

    local: error allowed. X (K, n): coefficients of the state, those of the drift in program.table.
    """
    for i in range(program.out.size):
        program.table[i, deg] = X[deg, i]
    if not h > 0.0:  # an event at the very end
        return h
    fits = program.width[0]
    # piece by piece; the width that held is handed on from step to step
    if fits < h < SPLIT * fits:
        h = fits
    width = h / np.ceil(h / fits)
    shortest = SHORTEST * h
    whole = h
    start = 0.0
    pieces = 0
    while start < h and pieces < PIECES:
        if width > 0.999 * (h - start):
            width = h - start
        margin = _certify_piece(start, width, whole, deg, t, local, program)
        wish = fitting_part(margin) * width
        if margin >= 1.0:
            # short pieces tell little of longer ones
            fits = max(fits, wish) if width < 0.7 * fits else wish
            start = h if width >= h - start else start + width
            pieces += 1
            continue
        fits = wish
        width = wish
        if not width >= shortest or (start > 0.0 and width < whole / PIECES):
            break
        if start == 0.0:
            h = min(h, width if h < SPLIT * width else width * PIECES)
            whole = h
    program.width[0] = fits
    return start if start < h else h
