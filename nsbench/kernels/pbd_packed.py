"""The time loop for one family of hard particles and rows of A on single ones: stored by cells, swept by schedule.

It is the sweep of kernels.pbd_near, bit for bit and faster. Candidates (kernels.packed) are what can become active
while no particle is farther than skin / 2 from where the list was made. That is checked after the drift for all and
after every projection for those it moved. Where it fails within a sweep, the sweep is undone (positions from a copy,
impulses from a log), the list made anew at the start of the sweep, longer if it was new already, and the sweep done again;
so nothing is ever done that the sweep over all constraints would not have done. Where lists would get too long, the run
is handed back (TOO_MANY) to be done by pbd_near.
"""
import numpy as np
from numba import njit

from nsbench.kernels import packed
from nsbench.kernels.packed import DEEP, near_rows, renew
from nsbench.kernels.pbd import NAN, OK, TIED

TOO_MANY = -1
ROOM = 11                 # pairs per particle held at most, unless the first list has half as many already,
FEW = 1500                # or there are few particles: all pairs of so many take 60 MB


@njit(cache=True, error_model="numpy")
def project_row(y, s, q, rows, b, dim):
    """Projection of particle s on row q, as kernels.project.project_row; returns mu."""
    ptr, cols, vals, inv2 = rows
    g = b[q]
    for e in range(ptr[q], ptr[q + 1]):
        g += vals[e] * y[s * dim + cols[e] % dim]
    if g >= 0.0:
        return 0.0
    mu = -g * inv2[q]
    for e in range(ptr[q], ptr[q + 1]):
        y[s * dim + cols[e] % dim] += mu * vals[e]
    return mu


@njit(cache=True, error_model="numpy")
def strayed(y, base, s, dim, limit2):
    """Whether particle s is farther than sqrt(limit2) from where the list was made."""
    far = 0.0
    for c in range(s * dim, (s + 1) * dim):
        e = y[c] - base[c]
        far += e * e
    return far > limit2


@njit(cache=True, error_model="numpy")
def project_pair(y, p, q, d, dim):
    """kernels.project.project_pair in any dimension, for sign + 1; returns mu, negative where centres coincide."""
    s = 0.0
    for c in range(dim):
        e = y[p * dim + c] - y[q * dim + c]
        s += e * e
    if s >= d * d:
        return 0.0
    r = np.sqrt(s)
    if r >= d:
        return 0.0
    mu = -0.5 * (r - d)
    if r == 0.0:
        y[p * dim] += mu
        y[q * dim] -= mu
        return -mu
    w = mu / r
    for c in range(dim):
        e = w * (y[p * dim + c] - y[q * dim + c])
        y[p * dim + c] += e
        y[q * dim + c] -= e
    return mu


@njit(cache=True, error_model="numpy")
def sweep(lists, y, base, r, dim, rows, b, limit2, log_at, log_mu, record):
    """Project on all candidates in the order given; impulses before each are logged.

    Returns the projections done, whether centres coincided, and whether a particle strayed (the sweep then ends).
    """
    if dim == 2 and r.size == 1:
        return sweep_discs(lists, y, base, 2.0 * r[0], rows, b, limit2, log_at, log_mu, record)
    i, j, mu = lists
    k, tied = 0, False
    for c in range(i.size):
        p, q = i[c], j[c]
        if q >= 0:
            m = project_pair(y, p, q, 2.0 * r[0] if r.size == 1 else r[p] + r[q], dim)
        else:
            m = project_row(y, p, -1 - q, rows, b, dim)
        if m == 0.0:
            continue
        tied = tied or m < 0.0
        if record:
            log_at[k], log_mu[k] = c, mu[c]
            mu[c] += abs(m)
        k += 1
        if strayed(y, base, p, dim, limit2) or (q >= 0 and strayed(y, base, q, dim, limit2)):
            return k, tied, True
    return k, tied, False


@njit(cache=True, error_model="numpy")
def sweep_discs(lists, y, base, d, rows, b, limit2, log_at, log_mu, record):
    """`sweep` in the plane for one diameter d. Indices are unsigned: numba then does not ask whether they count from the
    end, which would be a fourth of the time."""
    i, j, mu = lists
    one, two, k, d2, tied = np.uint64(1), np.uint64(2), np.uint64(0), d * d, False
    for c in range(i.size):
        if j[c] < 0:
            m = project_row(y, i[c], -1 - j[c], rows, b, 2)
            if m == 0.0:
                continue
            broken = strayed(y, base, i[c], 2, limit2)
        else:
            p, q = two * np.uint64(i[c]), two * np.uint64(j[c])
            ex, ey = y[p] - y[q], y[p + one] - y[q + one]
            s = ex * ex + ey * ey
            if s >= d2:
                continue
            length = np.sqrt(s)
            m = -0.5 * (length - d)
            if m <= 0.0:
                continue
            if length == 0.0:
                ex, tied = m, True
            else:
                w = m / length
                ex, ey = w * ex, w * ey
            px, py, qx, qy = y[p] + ex, y[p + one] + ey, y[q] - ex, y[q + one] - ey
            y[p], y[p + one], y[q], y[q + one] = px, py, qx, qy
            px, py, qx, qy = px - base[p], py - base[p + one], qx - base[q], qy - base[q + one]
            broken = max(px * px + py * py, qx * qx + qy * qy) > limit2
        if record:
            log_at[k], log_mu[k] = c, mu[c]
            mu[c] += m
        k += one
        if broken:
            return np.int64(k), tied, True
    return np.int64(k), tied, False


@njit(cache=True)
def undo(mu, y, start, log_at, log_mu, k):
    """Positions and impulses as they were before the sweep."""
    y[:] = start
    for e in range(k):
        mu[log_at[e]] = log_mu[e]


@njit(cache=True)
def drift(y, w, base, v, label, h, dim):
    """One step of Euler; w: a copy. Returns the largest squared distance from base, NaN where not all is finite."""
    far, good = 0.0, True
    for s in range(label.size):
        g = 0.0
        for c in range(dim):
            a = y[s * dim + c] + h * v[label[s] * dim + c]
            y[s * dim + c] = w[s * dim + c] = a
            good = good and abs(a) < 1e150
            g += (a - base[s * dim + c]) ** 2
        far = max(far, g)
    return far if good else np.nan


@njit(cache=True)
def farthest(y, base, dim):
    """The largest squared distance from base."""
    far = 0.0
    for s in range(y.size // dim):
        g = 0.0
        for c in range(s * dim, (s + 1) * dim):
            g += (y[c] - base[c]) ** 2
        far = max(far, g)
    return far


@njit(cache=True)
def settle(x, y, w, reac, label, dim):
    """What the sweep moved is reaction; x: positions by label."""
    for s in range(label.size):
        for c in range(dim):
            reac[s * dim + c] += y[s * dim + c] - w[s * dim + c]
            x[label[s] * dim + c] = y[s * dim + c]


@njit(cache=True)
def unpack(values, label, dim, out):
    """out[...] = values by label."""
    for s in range(label.size):
        for c in range(dim):
            out[label[s] * dim + c] = values[s * dim + c]


@njit(cache=True)
def flush(k, lists, kept, label, families, ids, values, count):
    """Move all impulses to the records (sample, family, i, j) and clear them; returns grown records."""
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
            a, q, m = label[i[c]], label[j[c]] if j[c] >= 0 else j[c], mu[c]
            mu[c] = 0.0
        else:
            a, q, m = ki[c - mu.size], kj[c - mu.size], kmu[c - mu.size]
        ids[count, 0], values[count] = k, m
        if q >= 0:
            ids[count, 1], ids[count, 2], ids[count, 3] = families[0, 0], min(a, q), max(a, q)
        else:
            q, u = -1 - q, families.shape[0] - 1
            while families[u, 1] > q:
                u -= 1
            ids[count, 1], ids[count, 2], ids[count, 3] = families[u, 0], q - families[u, 1], -1
        count += 1
    return ids, values, count


@njit(cache=True, error_model="numpy")
def march(f, b_of, moving, t, substeps, sweeps, x, rows, b, r, number, families, dim, reach, order, seed, record, state,
          particles, candidates):
    """As kernels.pbd_near.march. r: radii by label, or one for all; number: ranks (order CELL) or empty; families as in
    kernels.packed.fill_keys; record: whether impulses are kept (a run without is for measuring what that costs);
    state (6, N), particles, candidates: arrays to work in, as kernels.packed.room makes them.
    """
    K, n = t.size, x.size // dim
    X, R = np.full((K, x.size), np.nan), np.full((K, x.size), np.nan)
    y, w, reac, base, v, start = state[0], state[1], state[2], state[3], state[4], state[5 if sweeps > 1 else 1]
    x, label, none = x.copy(), particles[0], np.empty(0, np.int32)
    X[0] = R[0] = x
    R[0], y[:], w[:], base[:], reac[:] = 0.0, x, x, x, 0.0
    ids, values, count, kept, radii = np.empty((0, 4), np.int32), np.empty(0), 0, (none, none, np.empty(0)), r
    work, status, rebuilds, peak, calm, age, m = 0, OK, 0, 0, 0, 0, 0
    least, most, full, far = max(reach, 1e-9 * np.abs(x).max()), n * n, False, np.inf
    skin, near, valid = least, np.arange(rows[3].size if moving else 0).astype(np.int32), 0.0
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            f(now, x, v)
            moved = drift(y, w, base, v, label, h, dim)
            if not moved >= 0.0:
                return X, R, ids[:count], values[:count], work, NAN, now, rebuilds, peak
            far = moved if rebuilds > 0 else np.inf
            if moving:
                b_of(t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h, b)
            age, again = age + 1, 0
            for u in range(sweeps):
                if u > 0:
                    far = farthest(y, base, dim)
                    start[:] = y
                while True:
                    if far > (np.inf if full else (0.4999 * skin) ** 2):
                        if not moving:
                            valid -= np.sqrt(farthest(y, base, dim))
                            if valid < 0.5 * skin:
                                valid = 0.5 * DEEP * skin
                                near = near_rows(y, particles[1], rows, b, valid, dim, near, True)
                        m, kept, radii, pairs, candidates = renew(m, kept, particles, candidates, y, w, reac, base, r, skin,
                                                                  dim, rows, b, near, moving, families, number, order, seed,
                                                                  most)
                        if m < 0:
                            return X, R, ids[:count], values[:count], work, TOO_MANY, now, rebuilds, peak
                        if rebuilds == 0 and n > FEW:
                            most = max(ROOM * n, 2 * pairs)
                        if u > 0:
                            start[:] = y
                        full = pairs == n * (n - 1) // 2 and m == pairs + rows[3].size
                        rebuilds, peak, age, far = rebuilds + 1, max(peak, pairs), 0, 0.0
                    lists = candidates[0][:m], candidates[1][:m], candidates[4][:m]
                    log_at, log_mu = candidates[8], candidates[5].view(np.float64)
                    done, tied, broken = sweep(lists, y, base, radii, dim, rows, b, np.inf if full else (0.4999 * skin) ** 2,
                                               log_at, log_mu, record)
                    if not broken:
                        break
                    undo(lists[2], y, w if u == 0 else start, log_at, log_mu, done if record else 0)
                    if age == 0:             # a new list and yet too short
                        skin *= 1.5
                    again, far = again + 1, np.inf
                work += done
                status = TIED if tied else status
            calm = calm + 1 if again == 0 else 0
            if calm > 8 and skin > least:                # the storm is over: short lists again
                skin, calm = max(least, skin / 1.5), 0
            settle(x, y, w, reac, label, dim)
        X[k + 1] = x
        unpack(reac, label, dim, R[k + 1])
        ids, values, count = flush(k + 1, (candidates[0][:m], candidates[1][:m], candidates[4][:m]), kept, label, families,
                                   ids, values, count)
        kept = (none, none, np.empty(0))
    return X, R, ids[:count], values[:count], work, status, t[K - 1], rebuilds, peak


def room(n: int, N: int) -> tuple:
    """State and arrays to work in for n particles with N coordinates and some pairs each. Made by numpy: on large pages."""
    return np.empty((6, N)), *packed.room.py_func(n, 3 * n + 64)
