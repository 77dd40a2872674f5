"""Projection QP with many rows as a C callback: working-set update, else interior-point method.

The working set is that of the step before, updated row by row (working_set_update); where that
gives up, interior_point solves. Both use one assembly tree. See active_set_callback for few rows.

A file of its own: a C callback is compiled when its file is imported.
"""

import numpy as np

from nsbench.compilation.decorators import cfunc, inlined, inner_kernel
from nsbench.linalg.multifrontal import FrontWorkspace
from nsbench.linalg.nested_dissection import (
    LARGEST_FRONT,
    STACK,
    AssemblyTree,
    assembly_tree,
)
from nsbench.linalg.sparse_ldl import SparsityPattern, lengths
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import (
    CODE,
    GIVEN_UP,
    GROW,
    LARGE_SIGNATURE,
    ROUNDS,
    TREE_SIZE,
    WORK_SIZE,
)
from nsbench.qp.kernels.interior_point import (
    COLD_START,
    CONVERGED,
    INFEASIBLE,
    UNDECIDED,
    WARM_START,
    interior_point,
)
from nsbench.qp.kernels.working_set_update import update_working_set

TOL = 1e-10  # of the residual, a length
# signs wrong at first, and exchanges: more of them cost more than the interior point
WRONG_SIGNS = 50
MAX_EXCHANGES = 90
# tree_buffer: FILLED, then from BOUNDS on where its arrays begin, and the arrays from HEADER on
FILLED = 0
BOUNDS = 2
HEADER = 16
# places of the arrays in the buffer
ORDER, FIRST, UP, BPTR, BORDER, REL, PANEL, OPTR, OROW, LOC, SIZES = range(11)


@inner_kernel
def _store_tree(T, tree_buffer):
    """Write the arrays of an assembly tree one after the other into the buffer, if they fit;
    returns the size they need."""
    size = HEADER
    for a in T:
        size += a.size
    if size > tree_buffer.size:
        return size
    at = HEADER
    u = BOUNDS
    for a in T:
        tree_buffer[u] = at
        for k in range(a.size):
            tree_buffer[at + k] = a[k]
        at = at + a.size
        u = u + 1
    tree_buffer[u] = at
    return size


@inlined
def _stored_array(tree_buffer, place):
    """Return the array at a place of the buffer."""
    return tree_buffer[tree_buffer[BOUNDS + place] : tree_buffer[BOUNDS + place + 1]]


@inner_kernel
def _stored_tree(tree_buffer):
    """Return the assembly tree in the buffer, in the order in which _store_tree wrote it."""
    return AssemblyTree(
        order=_stored_array(tree_buffer, ORDER),
        first=_stored_array(tree_buffer, FIRST),
        up=_stored_array(tree_buffer, UP),
        bptr=_stored_array(tree_buffer, BPTR),
        border=_stored_array(tree_buffer, BORDER),
        rel=_stored_array(tree_buffer, REL),
        panel=_stored_array(tree_buffer, PANEL),
        optr=_stored_array(tree_buffer, OPTR),
        orow=_stored_array(tree_buffer, OROW),
        loc=_stored_array(tree_buffer, LOC),
        sizes=_stored_array(tree_buffer, SIZES),
    )


@inner_kernel
def _front_workspace(T, n, work_buffer):
    """Return the FrontWorkspace of a tree in the buffer, and the size it needs; the arrays are
    empty where they do not fit."""
    front = T.sizes[LARGEST_FRONT]
    panel_end = T.panel[T.panel.size - 1]
    front_end = panel_end + front * front
    stack_end = front_end + T.sizes[STACK] + 1
    size = stack_end + n + front
    return FrontWorkspace(
        work_buffer[:panel_end],
        work_buffer[panel_end:front_end],
        work_buffer[front_end:stack_end],
        work_buffer[stack_end:size],
    ), size


@inner_kernel
def _solve_scaled(P, T, room, vals, q, start, scale, mu, d, w):
    """Solve for rows of length 1 from mu = start; returns code and rounds. start is overwritten."""
    # A warm start is first updated row by row; the interior-point method takes over from there.
    code = UNDECIDED
    rounds = 0
    cold = True
    for k in range(q.size):
        cold = cold and start[k] == 0.0
    if not cold:
        done, rounds, swaps = update_working_set(
            P, T, room, vals, q, mu, TOL, np.int64(WRONG_SIGNS), np.int64(MAX_EXCHANGES), d, w
        )
        code = CONVERGED if done else UNDECIDED
        rounds = rounds + swaps
        if swaps > 0:  # what it has gained is a better start
            for k in range(q.size):
                start[k] = mu[k]
    if code == UNDECIDED:
        near = COLD_START if cold else WARM_START
        code, more = interior_point(P, T, room, vals, q, start, scale, TOL, mu, d, w, near)
        rounds += more
    if code == UNDECIDED and not cold:  # once more, from a cold start
        for k in range(q.size):
            start[k] = 0.0
        code, more = interior_point(P, T, room, vals, q, start, scale, TOL, mu, d, w, COLD_START)
        rounds += more
    return code, rounds


@cfunc(LARGE_SIGNATURE, cache=True, error_model="numpy")
def solve_large(
    ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, tree_buffer, work_buffer, mu, d, work
) -> None:
    """Solve the projection QP on the tree in the buffer, which is built first if it is not FILLED.

    The caller clears that for a new pattern. vals (e,), q, guess (m,): the problem; fills mu (m,),
    d (n,) and work (WORK,). Arguments and results: see qp.kernels.dispatch.
    """
    if tree_buffer[FILLED] == 0:
        work[TREE_SIZE] = _store_tree(assembly_tree(ptr, cols, tptr, trow), tree_buffer)
        if work[TREE_SIZE] > tree_buffer.size:
            work[CODE] = GROW
            return
        tree_buffer[FILLED] = 1
    T = _stored_tree(tree_buffer)
    room, work[WORK_SIZE] = _front_workspace(T, d.size, work_buffer)
    if work[WORK_SIZE] > work_buffer.size:
        work[CODE] = GROW
        return
    P = SparsityPattern(ptr, cols, tptr, trow, tpos, order)
    # rows of length 1: multipliers and slacks are lengths
    norm = lengths(P, vals)
    unit = np.empty(vals.size)
    scaled = np.empty(q.size)
    start = np.empty(q.size)
    w = np.empty(q.size)
    for k in range(q.size):
        for e in range(ptr[k], ptr[k + 1]):
            unit[e] = vals[e] / norm[k]
        scaled[k] = q[k] / norm[k]
        start[k] = max(guess[k], 0.0) * norm[k]
        mu[k] = start[k]
    code, rounds = _solve_scaled(P, T, room, unit, scaled, start, scale, mu, d, w)
    for k in range(q.size):
        mu[k] /= norm[k]
    if code == CONVERGED:
        work[CODE] = active_set.SOLVED
    else:
        work[CODE] = active_set.INFEASIBLE if code == INFEASIBLE else GIVEN_UP
    work[ROUNDS] = rounds
