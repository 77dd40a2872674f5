"""Time loop of the catching-up scheme: Euler, linearised gaps, least-distance problem.

Hard particles come from neighbour lists under a certificate (list_certificate): as long as its skin
suffices, no pair left out can be violated by a step, and the step is the one over all pairs.
Otherwise the list is built anew, with the skin that the step just solved asks for, and the step is
done again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inlined, njit
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.qp.kernels import active_set
from nsbench.solvers.catching_up.kernels.candidates import carry_multipliers
from nsbench.solvers.catching_up.kernels.list_certificate import needed_skins, next_skin
from nsbench.solvers.catching_up.kernels.projection_step import (
    ACTING,
    PEAK,
    REBUILDS,
    CandidateList,
    ContactScene,
    list_candidates,
    project,
)
from nsbench.solvers.common.kernels.step_code import StepCode, all_finite


class CatchingUpResult(NamedTuple):
    """The result of one run.

    x, reaction (K, n): states and integrals of the reaction at the recorded times, NaN behind the
    end. ids (R, 4), values (R,): records of impulse. counters (8,): places as in
    projection_step. worst,
    when: the largest KKT residual of a step, and the time of that step. code: a StepCode. reached:
    the time of the last step.
    """

    x: np.ndarray
    reaction: np.ndarray
    ids: np.ndarray
    values: np.ndarray
    counters: np.ndarray
    worst: float
    when: float
    code: int
    reached: float


class Motion(NamedTuple):
    """Arrays (n,) of the motion, overwritten by every step.

    x: the state; z: Euler's step from it; y: what the projection makes of that; v: the drift;
    reaction: its integral; base: where the list was built.
    """

    x: np.ndarray
    z: np.ndarray
    y: np.ndarray
    v: np.ndarray
    reaction: np.ndarray
    base: np.ndarray


class LoopState(NamedTuple):
    """What a step leaves to the next one, beside the motion.

    near: the list, its skin; guess (m,): the multipliers; book, store: of the solver, see
    qp.kernels.dispatch; worst, when: see CatchingUpResult.
    """

    near: CandidateList
    skin: float
    guess: np.ndarray
    book: np.ndarray
    store: np.ndarray
    worst: float
    when: float


class Records(NamedTuple):
    """Impulses of the samples: see CatchingUpResult; the first `size` entries are filled."""

    ids: np.ndarray
    values: np.ndarray
    size: int


@inlined
def record_impulses(sample, near, records):
    """Move the impulses of the list to the records of a sample; returns the Records."""
    at = near.contacts
    ids, values, size = records
    ids, values, size = flush(sample, near.impulse, at.family, at.i, at.j, ids, values, size)
    return Records(ids, values, size)


@inlined
def solve_step(exact, many, scene, motion, state, records, count, sample, now, reach):
    """Solve the projection of the step from motion.x over a list that is certified for it.

    sample: the next one, in the records; now: time at the start of the step; reach: least skin;
    others as in march. Returns d (n,), the code of active_set, the LoopState, its guess the
    multipliers of the step, and the Records.
    """
    x = motion.x
    near, skin, guess, book, store, worst, when = state
    # solve the step, and again over a longer list where the list is not certified for it
    while True:
        mu, d, code, kkt, book, store = project(
            exact, many, near, book, store, scene, x, motion.z, guess, count
        )
        for c in range(x.size):
            motion.y[c] = motion.z[c] + d[c]
        needed, alone = needed_skins(motion.base, x, motion.y, scene.hard, scene.radii, skin)
        if code == active_set.INFEASIBLE or not needed > skin:
            break
        records = record_impulses(sample, near, records)
        skin = next_skin(reach, alone)
        old_keys = near.keys
        near = list_candidates(x, skin, scene)
        guess = carry_multipliers(old_keys, mu, near.keys)
        book[0] = 0
        for c in range(x.size):
            motion.base[c] = x[c]
        count[REBUILDS] += 1
        count[PEAK] = max(count[PEAK], near.keys.size)
    if not kkt <= worst:
        worst = kkt
        when = now
    return d, code, LoopState(near, skin, mu, book, store, worst, when), records


@inlined
def advance(
    f, b_of, a_of, exact, many, moving, t, substeps, k, scene, motion, state, records, count, reach
):
    """Do the steps from sample k to sample k + 1.

    Arguments as in march. Returns the LoopState, the Records, a StepCode and the time reached.
    """
    x = motion.x
    z = motion.z
    h = (t[k + 1] - t[k]) / substeps[k]
    for s in range(substeps[k]):
        now = t[k] + s * h
        after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
        f(now, x, motion.v)
        for c in range(x.size):
            z[c] = x[c] + h * motion.v[c]
        if not all_finite(z):
            return state, records, StepCode.NAN, now
        if moving:
            b_of(after, scene.b)
            a_of(after, scene.anchors)
        d, code, state, records = solve_step(
            exact, many, scene, motion, state, records, count, k + 1, now, reach
        )
        if code == active_set.INFEASIBLE:
            return state, records, StepCode.INFEASIBLE, now
        for c in range(x.size):
            x[c] = z[c] + d[c]
            motion.reaction[c] += d[c]
        mu = state.guess
        for c in range(mu.size):
            state.near.impulse[c] += mu[c]
            count[ACTING] += mu[c] > 0.0
        if not all_finite(x):
            return state, records, StepCode.NAN, now
    return state, record_impulses(k + 1, state.near, records), StepCode.OK, t[k + 1]


@njit(cache=True, error_model="numpy")
def march(
    f, b_of, a_of, exact, many, moving, t, substeps, x, static, rows, b, anchors, hard, radii, reach
) -> CatchingUpResult:
    """Integrate from x (n,); returns a CatchingUpResult.

    f, b_of, a_of: pointers (t, x, out), (t, out), (t, out); moving: whether the last two depend on
    t; exact, many: functions of qp.kernels.dispatch; t (K,), substeps (K - 1,): the grid; static:
    ListedContacts by family; rows: AffineRows; hard (k, 4), radii: see gather; reach: least skin.
    """
    K = t.size
    n = x.size
    X = np.empty((K, n))
    R = np.empty((K, n))
    for k in range(K):
        for c in range(n):
            X[k, c] = R[k, c] = np.nan
    motion = Motion(
        x.copy(), np.empty(n), np.empty(n), np.empty(n), np.zeros(n), x.copy()
    )
    scene = ContactScene(static, rows, b, anchors, hard, radii)
    near = list_candidates(x, reach, scene)
    count = np.zeros(8, np.int64)
    count[REBUILDS], count[PEAK] = 1, near.keys.size
    guess = np.zeros(near.keys.size)
    book = np.zeros(2, np.int64)
    state = LoopState(near, reach, guess, book, np.empty(1), 0.0, t[0])
    records = Records(np.empty((64, 4), np.int64), np.empty(64), np.int64(0))
    for c in range(n):
        X[0, c] = x[c]
        R[0, c] = 0.0
    code = StepCode.OK
    reached = t[K - 1]
    for k in range(K - 1):
        state, records, code, reached = advance(
            f,
            b_of,
            a_of,
            exact,
            many,
            moving,
            t,
            substeps,
            k,
            scene,
            motion,
            state,
            records,
            count,
            reach,
        )
        if code != StepCode.OK:
            break
        for c in range(n):
            X[k + 1, c] = motion.x[c]
            R[k + 1, c] = motion.reaction[c]
    ids = records.ids[: records.size]
    values = records.values[: records.size]
    return CatchingUpResult(X, R, ids, values, count, state.worst, state.when, code, reached)
