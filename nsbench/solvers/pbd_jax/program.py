"""Time loop of PBD as one JAX program: level after level of constraints that share no particle.

The lists, their order and their levels come from the kernels of the compiled loop
(pbd/kernels/neighbor_list.py, constraint_order) on the host; the program uses them as long as no
particle is farther from where it was listed than the lists allow, which is tested after Euler's
step and after every level; a step that breaks this is taken back and done with new lists. Levels
are padded to one size, so that a program serves many lists; both sizes grow where a list needs it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.constraint_set import PAIR, ConstraintSet

if TYPE_CHECKING:
    import jax

DONE = 0
BROKEN = 1
NAN = 2
# levels and their capacities are multiples of these
LEVELS = 8
WIDTH = 64


@dataclass(frozen=True)
class Levels:
    """Constraints by level, as arrays of the program.

    pairs (L, C): first coordinates p, q (n where there is none), distance, sign, index in the list;
    rows (L, R, W): columns (n where there is none) and values, (L, R): row, index in the list.
    count: levels in use.
    """

    pairs: tuple
    rows: tuple
    count: int


@njit(cache=True)
def _level(things, n):
    """Return the level of each constraint: one more than the last one before it on its particles.

    things (m, k): particles or free coordinates of each constraint, -1: none; n: their number.
    """
    free = np.zeros(n, np.int64)
    level = np.empty(len(things), np.int64)
    # List scheduling: a constraint starts as soon as all its particles are free.
    for c in range(len(things)):
        at = 0
        for e in things[c]:
            if e >= 0:
                at = max(at, free[e])
        level[c] = at
        for e in things[c]:
            if e >= 0:
                free[e] = at + 1
    return level


def _entries(scene, rows, width):
    """Return the places (m, width) of the entries of rows among all, and which of them exist."""
    at = scene.ptr[rows][:, None] + np.arange(width)
    inside = at < scene.ptr[rows + 1][:, None]
    return np.where(inside, at, 0), inside


def _up(value, step):
    """Round value up: to a multiple of step, and by an eighth beyond eight of them."""
    step = max(step, step * (int(value) // (8 * step)))
    return step * -(-int(value) // step)


def arrange(
    lists, scene: ConstraintSet, owner: np.ndarray, sizes: tuple[int, int, int]
) -> tuple[Levels, tuple[int, int, int]]:
    """Sort listed constraints into levels, in the order of their sweep.

    lists: ListedContacts; owner (n, 2): see HardParticles; sizes: (levels, pairs, rows) that the
    program has room for. Returns the Levels and the sizes, unchanged or larger.
    """
    p = lists.p
    q = lists.q
    m = len(lists.kind)
    n = scene.n
    width = int(np.diff(scene.ptr).max(initial=1))
    particle = np.where(owner[:, 0] >= 0, owner[:, 0], np.arange(n))
    things = np.full((m, max(2, width)), -1, np.int64)
    pair = lists.kind == PAIR
    things[pair, 0] = particle[p[pair]]
    things[pair, 1] = particle[q[pair]]
    entry, inside = _entries(scene, p[~pair], width)
    things[~pair, :width] = np.where(
        inside, particle[scene.cols[entry]] if len(scene.cols) else -1, -1
    )
    level = _level(things, n)
    L = max(sizes[0], _up(level.max(initial=0) + 1, LEVELS))
    place = np.empty(m, np.int64)
    most = []
    for chosen in (pair, ~pair):
        order = np.flatnonzero(chosen)[np.argsort(level[chosen], kind="stable")]
        place[order] = np.arange(len(order)) - np.searchsorted(level[order], level[order])
        most.append(place[order].max(initial=-1) + 1)
    C, R = (max(s, _up(v, WIDTH) if v else 0) for s, v in zip(sizes[1:], most, strict=True))
    pairs = _pad_pairs(lists, pair, level, place, n, (L, C))
    rows = _pad_rows(lists, ~pair, level, place, scene, entry, inside, (L, R, width))
    return Levels(pairs, rows, int(level.max(initial=-1) + 1)), (L, C, R)


def _pad_pairs(lists, pair, level, place, n, shape):
    """Return the arrays of Levels.pairs, each of the shape (L, C).

    pair (m,): which of the listed constraints are pairs; level, place (m,): where each belongs; n:
    size of the state.
    """
    a = level[pair]
    b = place[pair]
    P, Q, D, S, N = (np.full(shape, v) for v in (n, n, 0.0, 1.0, len(pair)))
    P[a, b] = lists.p[pair]
    Q[a, b] = lists.q[pair]
    D[a, b] = lists.d[pair]
    S[a, b] = lists.sign[pair]
    N[a, b] = np.flatnonzero(pair)
    return P, Q, D, S, N


def _pad_rows(lists, chosen, level, place, scene, entry, inside, shape):
    """Return the arrays of Levels.rows; shape: (L, R, W), W entries of the longest row.

    chosen (m,): which of the listed constraints are rows; level, place (m,): where each belongs;
    entry, inside: of _entries.
    """
    a = level[chosen]
    b = place[chosen]
    cols = np.full(shape, scene.n)
    vals = np.zeros(shape)
    row = np.zeros(shape[:2], np.int64)
    number = np.full(shape[:2], len(chosen))
    row[a, b] = lists.p[chosen]
    number[a, b] = np.flatnonzero(chosen)
    if len(scene.cols):
        cols[a, b] = np.where(inside, scene.cols[entry], scene.n)
        vals[a, b] = np.where(inside, scene.vals[entry], 0.0)
    return cols, vals, row, number


def advance(
    drift: Callable, b_of: Callable, inv2: np.ndarray, owned: np.ndarray, dim: int, sweeps: int
) -> Callable:
    """Return the time loop between two recorded times, as a function for jax.jit.

    drift (t, x) and b_of (t): in JAX; inv2: 1/|A_r|^2 of all rows; owned (n,): whether a coordinate
    belongs to a hard particle, whose displacement counts; sweeps: per step.

    The function (x, reaction, mu, t0, t1, h, first, substeps, pairs, rows, count, base, limit) does
    the steps from `first` on. mu has one entry more than there are constraints; pairs, rows, count:
    of Levels; limit: how far a coordinate may be from `base`. It returns x, reaction, mu, the step
    reached, the state (DONE, BROKEN, NAN), the projections done, and whether centres coincided.
    """
    import jax.numpy as jnp
    from jax import lax

    def run(x, reaction, mu, t0, t1, h, first, substeps, pairs, rows, count, base, limit):
        counts = jnp.asarray(owned)
        sweep = _sweep_over_level(inv2, dim, counts, pairs, rows, count, base, limit)

        def step(c: tuple) -> tuple:
            x, reaction, mu, s, _, work, tied = c
            now = t0 + s * h
            after = jnp.where(s + 1 == substeps, t1, t0 + (s + 1) * h)
            y = x + h * drift(now, x)
            finite = (jnp.abs(y) < 1e150).all()
            broken = ((jnp.abs(y - base) > limit) & counts).any()
            b = b_of(after)
            z, mu1, work1, tied1, broken = lax.fori_loop(
                0,
                jnp.where(broken | ~finite, 0, count * sweeps),
                lambda turn, c: sweep(turn, c, b),
                (y, mu, work, tied, broken),
            )
            state = jnp.where(~finite, NAN, jnp.where(broken, BROKEN, DONE))
            good = state == DONE
            # a step that breaks the certificate is taken back
            keep = lambda new, old: jnp.where(good, new, old)
            return (
                keep(z, x),
                keep(reaction + (z - y), reaction),
                keep(mu1, mu),
                s + good,
                state,
                keep(work1, work),
                keep(tied1, tied),
            )

        def goes_on(c: tuple) -> jax.Array:
            _, _, _, s, state, _, _ = c
            return (s < substeps) & (state == DONE)

        start = (jnp.array(DONE), jnp.array(0), jnp.array(False))
        return lax.while_loop(goes_on, step, (x, reaction, mu, first, *start))

    return run


def _sweep_over_level(inv2, dim, counts, pairs, rows, count, base, limit):
    """Build the sweep over one level: (turn, (x, mu, work, tied, broken), b) -> the same after it.

    The level is turn % count.
    """
    import jax.numpy as jnp
    from jax import lax

    first, *_ = pairs
    *_, row, _ = rows

    def any_beyond(moved: tuple) -> jax.Array:
        return (
            sum(
                (
                    (
                        (jnp.abs(value - base.at[at].get(mode="fill", fill_value=0.0)) > limit)
                        & counts.at[at].get(mode="fill", fill_value=False)
                    ).any()
                )
                for at, value in moved
            )
            > 0
        )

    def level_of(arrays: tuple, lev: jax.Array) -> tuple:
        return tuple(lax.dynamic_index_in_dim(a, lev, keepdims=False) for a in arrays)

    def sweep(turn: jax.Array, c: tuple, b: jax.Array) -> tuple:
        lev = turn % count

        x, mu, work, tied, broken = c
        if first.shape[1]:
            x, mu, done, ties, moved = _project_pairs(x, mu, level_of(pairs, lev), dim)
            work = work + done
            tied = tied | ties
            broken = broken | any_beyond(moved)
        if row.shape[1]:
            x, mu, done, moved = _project_rows(x, mu, b, level_of(rows, lev), inv2)
            work = work + done
            broken = broken | any_beyond(moved)
        return x, mu, work, tied, broken

    return sweep


def _project_pairs(x, mu, level, dim):
    """Project on all pairs of a level at once.

    Returns x, mu, the projections done, whether centres coincided, and the coordinates moved with
    their new values.
    """
    import jax.numpy as jnp

    p, q, d, sign, number = level
    axes = np.arange(dim)
    i = p[:, None] + axes
    j = q[:, None] + axes
    xi = x.at[i].get(mode="fill", fill_value=0.0)
    xj = x.at[j].get(mode="fill", fill_value=0.0)
    diff = xi - xj
    s = (diff * diff).sum(1)
    r = jnp.sqrt(s)
    g = sign * (r - d)
    hit = ((sign > 0.0) != (s >= d * d)) & (g < 0.0) & (p < x.size)
    push = jnp.where(hit, -0.5 * g, 0.0)
    tied = hit & (r == 0.0)
    e = jnp.where(
        tied[:, None],
        push[:, None] * np.eye(dim)[0],
        (sign * push / jnp.where(r == 0.0, 1.0, r))[:, None] * diff,
    )
    xi = xi + e
    xj = xj - e
    x = (
        x.at[i]
        .set(xi, mode="drop", unique_indices=True)
        .at[j]
        .set(xj, mode="drop", unique_indices=True)
    )
    return x, mu.at[number].add(push), hit.sum(), tied.any(), ((i, xi), (j, xj))


def _project_rows(x, mu, b, level, inv2):
    """Project on all rows of a level at once; returns as _project_pairs, without coincidence."""
    import jax.numpy as jnp

    cols, vals, row, number = level
    g = (vals * x.at[cols].get(mode="fill", fill_value=0.0)).sum(1) + b[row]
    push = jnp.where((g < 0.0) & (number < mu.size - 1), -g * jnp.asarray(inv2)[row], 0.0)
    x = x.at[cols].add(push[:, None] * vals, mode="drop")
    return (
        x,
        mu.at[number].add(push),
        (push > 0.0).sum(),
        ((cols, x.at[cols].get(mode="fill", fill_value=0.0)),),
    )
