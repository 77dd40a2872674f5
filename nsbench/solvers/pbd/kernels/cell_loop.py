"""The time loop for one family of hard particles and rows of A on single ones: stored by cells,
swept by schedule.

It is the sweep of kernels.pbd_near, bit for bit and faster. Candidates (kernels.packed) are what
can become active while no particle is farther than skin / 2 from where the list was made; swept
over are those of them (kernels.close) that can while none is farther than a smaller skin / 2 from
where they were chosen. That is checked after the drift for all and after every projection for those
it moved. Where it fails within a sweep, the sweep is undone (positions made anew, impulses from a
log), the choice or the list made anew at the start of the sweep, wider if new already, and the
sweep done again;
so nothing is ever done that the sweep over all constraints would not have done. Where lists would
get too long, the run is handed back (TOO_MANY) to be done by pbd_near.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.solvers.pbd.kernels import cell_storage, threaded_loop
from nsbench.solvers.pbd.kernels.active_candidates import (
    inner_skin,
    restore_impulses,
    select_active,
)
from nsbench.solvers.pbd.kernels.cell_step import drift, farthest, settle
from nsbench.solvers.pbd.kernels.cell_storage import DEEP, listed, near_rows, rebuild
from nsbench.solvers.pbd.kernels.cell_sweep import sweep
from nsbench.solvers.pbd.kernels.listed_loop import NAN, OK, TIED

TOO_MANY = -1
TOO_SMALL = -2
ROOM = 11  # pairs per particle held at most, unless the first list has half as many already,
FEW = 1500  # or there are few particles: all pairs of so many take 60 MB


@njit(cache=True)
def undo(mu, log_at, log_mu, k):
    """Impulses as they were before the sweep."""
    for e in range(k):
        mu[log_at[e]] = log_mu[e]


@njit(cache=True)
def unpack(values, label, dim, out):
    """out[...] = values by label."""
    for s in range(label.size):
        for c in range(dim):
            out[label[s] * dim + c] = values[s * dim + c]


@njit(cache=True)
def flush(k, lists, kept, label, families, ids, values, count):
    """Move all impulses to the records (sample, family, i, j) and clear them; returns grown
    records."""
    i, j, mu = lists
    ki, kj, kmu = kept
    need = kmu.size
    for c in range(mu.size):
        need += mu[c] != 0.0
    if count + need > values.size:
        room = max(need, values.size // 2)
        ids = np.concatenate((ids[:count], np.empty((room, 4), np.int32)))
        values = np.concatenate((values[:count], np.empty(room)))
    for c in range(mu.size + kmu.size):
        if c < mu.size:
            if mu[c] == 0.0:
                continue
            a = label[i[c]]
            q = label[j[c]] if j[c] >= 0 else j[c]
            m = mu[c]
            mu[c] = 0.0
        else:
            a = ki[c - mu.size]
            q = kj[c - mu.size]
            m = kmu[c - mu.size]
        ids[count, 0] = k
        values[count] = m
        if q >= 0:
            ids[count, 1], ids[count, 2], ids[count, 3] = families[0, 0], min(a, q), max(a, q)
        else:
            q = -1 - q
            u = families.shape[0] - 1
            while families[u, 1] > q:
                u -= 1
            ids[count, 1] = families[u, 0]
            ids[count, 2] = q - families[u, 1]
            ids[count, 3] = -1
        count += 1
    return ids, values, count


@njit(cache=True, error_model="numpy")
def refresh_candidates(
    crew,
    sizes,
    widths,
    least,
    kept,
    radii,
    particles,
    candidates,
    state,
    r,
    dim,
    rows,
    b,
    near,
    moving,
    families,
    number,
    order,
    seed,
    record,
):
    """Candidates chosen for the positions at hand (kernels.close), from a new list if the one there
    is used up.

    sizes: candidates, chosen ones, lists made, pairs at most, whether all constraints are listed,
    pairs allowed; widths:
    skin of the list, of the choice, how far the rows looked at are valid, what of the skin is left.
    Returns kept, radii, near and the candidates' arrays; sizes[0] = -1 where lists get too long.
    """
    y = state[0]
    reac = state[1]
    base = state[2]
    spot = state[3]
    n = state[0].size // dim
    if record:
        if crew is None:
            restore_impulses(
                listed(candidates, sizes[0])[2],
                candidates[7][: sizes[1]],
                candidates[5][: sizes[1]],
            )
        else:
            threaded_loop.together(crew, threaded_loop.PUT_BACK)
    gone = np.sqrt(farthest(y, base, dim, 0, n))
    left = widths[0] - 2.0002 * gone  # 2e-4 of the skin is for rounding
    wide = (
        widths[1] >= least
    )  # sweeps move particles by more than the list is made for: all of it is chosen
    if sizes[2] == 0 or (sizes[4] == 0 and (wide or left < 0.6 * widths[1])):
        widths[0] = max(least, widths[1])
        which = near
        if not moving:
            widths[2] -= gone
            if widths[2] < 0.5 * widths[0]:
                widths[2] = 0.5 * DEEP * widths[0]
                near = near_rows(y, particles[1], rows, b, widths[2], dim, near, True)
            which = near_rows(y, particles[1], rows, b, 0.5 * widths[0], dim, near, False)
        sizes[0], kept, radii, pairs, candidates = rebuild(
            crew,
            sizes[0],
            kept,
            particles,
            candidates,
            y,
            reac,
            base,
            spot,
            r,
            widths[0],
            dim,
            rows,
            b,
            which,
            families,
            number,
            order,
            seed,
            sizes[5],
        )
        if sizes[0] < 0:
            return kept, radii, near, candidates
        if sizes[2] == 0 and n > FEW:
            sizes[5] = max(ROOM * n, 2 * pairs)
        sizes[2], sizes[3], left = sizes[2] + 1, max(sizes[3], pairs), widths[0]
        sizes[4] = pairs == n * (n - 1) // 2 and sizes[0] == pairs + rows[3].size
    widths[3] = min(widths[1], left)
    if sizes[4] == 1:
        widths[3] = np.inf if wide else widths[1]
    if crew is None:
        half = candidates[3].size
        chosen = candidates[2][:half], candidates[2][half:], candidates[7], candidates[5]
        sizes[1] = select_active(
            listed(candidates, sizes[0]), chosen, y, radii, widths[3], dim, rows, b, moving
        )
        spot[:] = y
    else:
        sizes[1] = threaded_loop.choose_all(crew, radii, widths[3])
    return kept, radii, near, candidates


@njit(cache=True, error_model="numpy", nogil=True)
def march(
    f,
    b_of,
    moving,
    t,
    substeps,
    sweeps,
    x,
    rows,
    b,
    r,
    number,
    families,
    dim,
    reach,
    order,
    seed,
    record,
    crew,
    samples,
    state,
    particles,
    candidates,
):
    """As kernels.pbd_near.march. r: radii by label, or one for all; number: ranks (order CELL) or
    empty; families as in kernels.packed.fill_keys; record: whether impulses are kept (a run without
    is for measuring what that costs);
    crew: None, or that of kernels.pbd_threads; samples (2, K, N): places to fill with states and
    reactions; state (6, N), particles, candidates: arrays to work in, as `room` makes them.
    """
    K = t.size
    n = x.size // dim
    X = samples[0]
    R = samples[1]
    none = np.empty(0, np.int32)
    y = state[0]
    reac = state[1]
    base = state[2]
    spot = state[3]
    v = state[4]
    start = state[5]
    label = particles[0]
    X[0] = x
    y[:] = x
    base[:] = x
    spot[:] = x
    R[0] = 0.0
    reac[:] = 0.0
    for s in range(label.size):  # the room may have been used before
        label[s] = particles[1][s] = s
    ids = np.empty((0, 4), np.int32)
    values = np.empty(0)
    count = 0
    kept = (none, none, np.empty(0))
    radii = r
    work = 0
    status = OK
    calm = 0
    age = 0
    reserve = 0.15
    storm = 0.0
    pace = np.inf
    radius = r.mean()
    sizes = np.array([0, 0, 0, 0, 0, n * n])
    least = max(reach, 1e-8 * np.abs(x).max())
    widths = np.array([least, 0.3 * least, 0.0, 0.0])
    near = np.arange(rows[3].size if moving else 0).astype(np.int32)
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        X[k + 1] = X[k]
        z = X[k + 1]
        for s in range(substeps[k]):
            now = t[k] + s * h
            f(now, z, v)
            if crew is None:
                far = drift(z, y, spot, v, label, h, dim, 0, label.size)
            else:
                far = threaded_loop.drift_all(crew, k + 1, h)
            if not far >= 0.0:
                X[k + 1 :], R[k + 1 :] = np.nan, np.nan
                return X, R, ids[:count], values[:count], work, NAN, now, sizes[2], sizes[3]
            if moving:
                b_of(t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h, b)
            age = age + 1
            again = 0
            for u in range(sweeps):
                if u > 0:
                    far = farthest(y, spot, dim, 0, label.size)
                    start[:] = y
                while True:
                    if (
                        sizes[2] == 0
                        or again > 0
                        or far > ((0.4999 - (reserve if storm == 0.0 else 0.0)) * widths[3]) ** 2
                    ):
                        if again == 0:
                            pace = np.sqrt(far) / max(age, 1)
                            reserve = max(0.05, 0.97 * reserve) if sizes[2] > 0 else reserve
                        widths[1] = max(storm, inner_skin(pace, radius, least))
                        kept, radii, near, candidates = refresh_candidates(
                            crew,
                            sizes,
                            widths,
                            least,
                            kept,
                            radii,
                            particles,
                            candidates,
                            state,
                            r,
                            dim,
                            rows,
                            b,
                            near,
                            moving,
                            families,
                            number,
                            order,
                            seed,
                            record,
                        )
                        if sizes[0] < 0:
                            code = TOO_MANY if sizes[0] == -1 else TOO_SMALL
                            return (
                                X,
                                R,
                                ids[:count],
                                values[:count],
                                -sizes[0],
                                code,
                                now,
                                sizes[2],
                                sizes[3],
                            )
                        if u > 0:
                            start[:] = y
                        age = 0
                    limit2 = (0.4999 * widths[3]) ** 2
                    if crew is None:
                        half = candidates[3].size
                        c = sizes[1]
                        lists = candidates[2][:c], candidates[2][half : half + c], candidates[5][:c]
                        done, tied, broken = sweep(
                            lists,
                            y,
                            spot,
                            radii,
                            dim,
                            rows,
                            b,
                            limit2,
                            candidates[3],
                            candidates[6],
                            record,
                        )
                    else:
                        done, tied, broken = threaded_loop.sweep_all(crew, limit2)
                    if not broken:
                        break
                    if u == 0:
                        drift(z, y, spot, v, label, h, dim, 0, label.size)
                    else:
                        y[:] = start
                    if record:
                        if crew is None:
                            undo(candidates[5], candidates[3], candidates[6], done)
                        else:
                            threaded_loop.undo_all(crew)
                    if age == 0:  # a new choice and yet too narrow
                        storm = 1.5 * max(least, widths[1])
                    else:
                        reserve = min(0.3, 1.25 * reserve)
                    again += 1
                work += done
                status = TIED if tied else status
            calm = calm + 1 if again == 0 else 0
            if calm > 8 and storm > 0.0:  # the storm is over: narrow again
                storm = storm / 1.5 if storm > 1.5 * least else 0.0
                calm = 0
                widths[3] = 0.0 if storm == 0.0 else widths[3]
            if crew is None:
                settle(z, y, v, reac, label, h, dim, 0, label.size)
            else:
                threaded_loop.together(crew, threaded_loop.SETTLE)
        unpack(reac, label, dim, R[k + 1])
        if record:
            if crew is None:
                restore_impulses(
                    listed(candidates, sizes[0])[2],
                    candidates[7][: sizes[1]],
                    candidates[5][: sizes[1]],
                )
                candidates[5][: sizes[1]] = 0.0
            else:
                threaded_loop.together(crew, threaded_loop.PUT_BACK)
                candidates[5][: sizes[0]] = 0.0
            ids, values, count = flush(
                k + 1, listed(candidates, sizes[0]), kept, label, families, ids, values, count
            )
        kept = (none, none, np.empty(0))
    return X, R, ids[:count], values[:count], work, status, t[K - 1], sizes[2], sizes[3]


def room(n: int, N: int, m: int = 0) -> tuple:
    """State and arrays to work in for n particles with N coordinates and m candidates, 0: some for
    each. Made by numpy: on large pages."""
    return np.empty((6, N)), *cell_storage.workspace.py_func(n, m or 8 * n + 64)
