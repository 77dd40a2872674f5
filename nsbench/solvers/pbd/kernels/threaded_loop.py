"""The steps of kernels.pbd_packed by several threads, with the bits of one: the store in strips, a
strip a thread.

Constraints are put into classes (schedule.divide): of each strip those that wait for nothing
outside it; then those about each border between strips that wait for nothing else; the rest. The
strips are swept over at once, then the borders, then the rest, each class in the order of one
thread; so nobody overtakes whom it waits for, and every particle goes through the same positions
whatever the threads. The largest distance, the projections counted and whether a sweep broke its
certificate do not depend on who finds them. Where that does not hold by itself (a sweep that ends
early), it is undone and nothing of it is kept.

A crew is None (one thread: none of this is compiled) or the tuple that `crew` makes: what is
posted, what each reports, where the classes begin, and the arrays of the march.
"""

import threading
from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.solvers.pbd.kernels.active_candidates import restore_impulses, select_active
from nsbench.solvers.pbd.kernels.cell_step import drift, settle
from nsbench.solvers.pbd.kernels.cell_storage import listed
from nsbench.solvers.pbd.kernels.cell_sweep import sweep
from nsbench.solvers.pbd.kernels.thread_team import (
    DIM,
    DONE,
    JOB,
    POSTED,
    ROW,
    STOP,
    finish,
    post,
    raise_,
    wait,
    words,
)

DRIFT, SWEEP, BORDERS, SETTLE, CHOOSE, PUT_BACK = range(6)
STEP, LIMIT2, WIDTH, MOVING, RECORD = range(5)  # places in `number`


@njit(cache=True, nogil=True)
def share(me, threads, n):
    """The particles of a thread's strip."""
    return me * n // threads, (me + 1) * n // threads


@njit(cache=True, nogil=True)
def sweep_class(c, crew):
    """Sweep over the chosen constraints of class c, and report (done, tied, broken)."""
    word, number, tally, _, ends, chosen, _, state, _, candidates, rows, b, radii = crew
    lo = ends[c]
    m = chosen[c]
    half = candidates[3].size
    lists = (
        candidates[2][lo : lo + m],
        candidates[2][half + lo : half + lo + m],
        candidates[5][lo : lo + m],
    )
    done, tied, broken = sweep(
        lists,
        state[0],
        state[3],
        radii,
        word[DIM],
        rows,
        b,
        number[LIMIT2],
        candidates[3][lo : lo + m],
        candidates[6][lo : lo + m],
        number[RECORD] != 0.0,
    )
    tally[c, 0] = done
    tally[c, 1] = tied
    tally[c, 2] = broken


@njit(cache=True, nogil=True)
def choose_class(c, crew):
    """Choose anew among the candidates of class c (kernels.close)."""
    word, number, _, _, ends, chosen, _, state, _, candidates, rows, b, radii = crew
    lo = ends[c]
    hi = ends[c + 1]
    half = candidates[3].size
    i, j, mu = listed(candidates, hi)
    into = (
        candidates[2][lo:hi],
        candidates[2][half + lo : half + hi],
        candidates[7][lo:hi],
        candidates[5][lo:hi],
    )
    chosen[c] = select_active(
        (i[lo:], j[lo:], mu[lo:]),
        into,
        state[0],
        radii,
        number[WIDTH],
        word[DIM],
        rows,
        b,
        number[MOVING] != 0.0,
    )


@njit(cache=True, nogil=True)
def put_back_class(c, crew):
    """Impulses of the chosen of class c to the list."""
    _, _, _, _, ends, chosen, _, _, _, candidates, _, _, _ = crew
    lo = ends[c]
    m = chosen[c]
    restore_impulses(
        listed(candidates, ends[c + 1])[2][lo:],
        candidates[7][lo : lo + m],
        candidates[5][lo : lo + m],
    )


@njit(cache=True, nogil=True)
def part(me, crew):
    """One thread's part of the job posted."""
    word, number, _, far, _, _, samples, state, particles, _, _, _, _ = crew
    threads = far.shape[0]
    job = word[JOB]
    dim = word[DIM]
    label = particles[0]
    y = state[0]
    reac = state[1]
    spot = state[3]
    v = state[4]
    lo, hi = share(me, threads, label.size)
    if job == DRIFT:
        far[me, 0] = drift(samples[0, word[ROW]], y, spot, v, label, number[STEP], dim, lo, hi)
    elif job == SETTLE:
        settle(samples[0, word[ROW]], y, v, reac, label, number[STEP], dim, lo, hi)
    elif job == SWEEP:
        sweep_class(me, crew)
    elif job == BORDERS:
        sweep_class(threads + 1 + me, crew)
    else:
        for c in range(me, 2 * threads + 2, threads):
            if job == CHOOSE:
                choose_class(c, crew)
            else:
                put_back_class(c, crew)
        if job == CHOOSE:
            spot[lo * dim : hi * dim] = y[lo * dim : hi * dim]


@njit(cache=True, nogil=True)
def serve(me, crew):
    """Do a thread's parts until the crew is stopped."""
    word = crew[0]
    jobs = 0
    while True:
        jobs += 1
        wait(word, POSTED, jobs)
        if word[JOB] == STOP:
            return
        part(me, crew)
        raise_(word, DONE)


@njit(cache=True, nogil=True)
def together(crew, job):
    """The job by all threads; returns when it is done."""
    post(crew[0], job)
    part(0, crew)
    finish(crew[0], crew[3].shape[0] - 1)


@njit(cache=True, nogil=True)
def drift_all(crew, row, h):
    """kernels.pbd_step.drift of all particles from the sample of that number."""
    crew[0][ROW] = row
    crew[1][STEP] = h
    together(crew, DRIFT)
    far = 0.0
    for c in range(crew[3].shape[0]):
        if not crew[3][c, 0] <= far:
            far = crew[3][c, 0]
        if far != far:  # no later one may hide it
            break
    return far


@njit(cache=True, nogil=True)
def choose_all(crew, radii, skin):
    """Choose for the positions at hand among the candidates; returns how many. radii: in the order
    of the store."""
    crew[12][:] = radii
    crew[1][WIDTH] = skin
    together(crew, CHOOSE)
    return crew[5].sum()


@njit(cache=True, nogil=True)
def sweep_all(crew, limit2):
    """The sweep: strips, borders, the rest. Returns as kernels.pbd_sweep.sweep."""
    tally = crew[2]
    threads = crew[3].shape[0]
    crew[1][LIMIT2] = limit2
    tally[:] = 0
    together(crew, SWEEP)
    if not np.any(tally[:, 2] != 0):
        sweep_class(threads, crew)
        if threads > 2:  # of two strips there is one border
            together(crew, BORDERS)
        else:
            for c in range(threads + 1, 2 * threads + 1):
                sweep_class(c, crew)
    if not np.any(tally[:, 2] != 0):
        sweep_class(2 * threads + 1, crew)
    return tally[:, 0].sum(), np.any(tally[:, 1] != 0), np.any(tally[:, 2] != 0)


@njit(cache=True, nogil=True)
def undo_all(crew):
    """Impulses as they were before the sweep."""
    _, _, tally, _, ends, _, _, _, _, candidates, _, _, _ = crew
    for c in range(tally.shape[0]):
        for e in range(ends[c], ends[c] + tally[c, 0]):
            candidates[5][ends[c] + candidates[3][e]] = candidates[6][e]


def crew(
    threads: int,
    dim: int,
    moving: bool,
    record: bool,
    samples: np.ndarray,
    space: tuple,
    rows: tuple,
    b: np.ndarray,
    r: np.ndarray,
) -> tuple:
    """Words, numbers, reports by class and by thread, ends of the classes, chosen of each, then
    what the march works on.

    space: state, particles, candidates as kernels.pbd_packed.room makes them; the rest as in its
    march.
    """
    word = words()
    number = np.zeros(8)
    classes = 2 * threads + 2
    word[DIM] = dim
    number[MOVING] = moving
    number[RECORD] = record
    return (
        word,
        number,
        np.zeros((classes, 8), np.int64),
        np.zeros((threads, 8)),
        np.zeros(classes + 1, np.int64),
        np.zeros(classes, np.int64),
        samples,
        *space,
        rows,
        b,
        r.copy(),
    )


def run_with(crew: tuple, march: Callable, args: tuple):
    """What `march(*args)` returns; the other threads of the crew wait for its jobs meanwhile."""
    word = crew[0]
    others = crew[3].shape[0] - 1
    helpers = []
    try:
        for k in range(others):
            helpers.append(threading.Thread(target=serve, args=(1 + k, crew), daemon=True))
            helpers[-1].start()
        return march(*args)
    finally:  # also when memory runs out within: whoever is at a part ends it first
        post(word, STOP)
        for thread in helpers:
            if thread.ident is not None:  # else it could not be started
                thread.join()
