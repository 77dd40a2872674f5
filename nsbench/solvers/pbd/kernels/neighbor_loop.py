"""The same loop with hard particles: near pairs under a certificate, bit for bit the sweep over all
pairs.

A list holds every pair whose gap was at most `reach` when it was built. As long as no particle has
moved by more than reach / 2 since, a pair outside the list cannot overlap, and leaving it out
changes nothing. The distance moved is checked after the drift and after every single projection;
when it is exceeded in the middle of a sweep, the list is built anew at the present positions and
the sweep goes on behind the constraint it had reached: nothing is undone, and no pair is missed.
The order of the sweep is defined by the scene (keys), never by the list.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.cell_list import near_pairs
from nsbench.dynamics.contacts.kernels.constraint_order import static_keys, sweep_key
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.solvers.pbd.kernels.listed_loop import NAN, OK, TIED, finite
from nsbench.solvers.pbd.kernels.projection import project_anchor, project_pair, project_row


@njit(cache=True)
def joined(a, b, chosen):
    """a with the chosen entries of b behind it."""
    out = np.empty(a.size + chosen.size, a.dtype)
    for c in range(a.size):
        out[c] = a[c]
    for c in range(chosen.size):
        out[a.size + c] = b[chosen[c]]
    return out


@njit(cache=True)
def append(lists, keys, other, other_keys, chosen):
    """Lists and keys with the chosen entries of another list behind them."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = lists
    b0, b1, b2, b3, b4, b5, b6, b7, b8 = other
    o = chosen
    return (
        joined(a0, b0, o),
        joined(a1, b1, o),
        joined(a2, b2, o),
        joined(a3, b3, o),
        joined(a4, b4, o),
        joined(a5, b5, o),
        joined(a6, b6, o),
        joined(a7, b7, o),
        joined(a8, b8, o),
    ), joined(keys, other_keys, o)


@njit(cache=True)
def ascending(keys):
    """The order (m,) in which keys ascend: runs that ascend already are merged, two by two."""
    m = keys.size
    order = np.arange(m)
    other = np.empty(m, np.int64)
    ends = np.empty(m + 1, np.int64)
    runs = 0
    ends[0] = 0
    for c in range(1, m + 1):
        if c == m or keys[c] < keys[c - 1]:
            runs += 1
            ends[runs] = c
    while runs > 1:
        left = 0
        for u in range(0, runs, 2):
            lo = ends[u]
            mid = ends[u + 1]
            hi = ends[min(u + 2, runs)]
            a = lo
            b = mid
            for c in range(lo, hi):
                if b == hi or (a < mid and keys[order[a]] <= keys[order[b]]):
                    other[c] = order[a]
                    a += 1
                else:
                    other[c] = order[b]
                    b += 1
            left += 1
            ends[left] = hi
        order, other, runs = other, order, left
    return order


@njit(cache=True)
def in_order(lists, keys):
    """Lists and keys sorted by key."""
    up = True
    down = True
    for c in range(1, keys.size):
        up = up and keys[c - 1] < keys[c]
        down = down and keys[c - 1] > keys[c]
    if up:
        return lists, keys
    if down:
        o = np.empty(keys.size, np.int64)
        for c in range(keys.size):
            o[c] = keys.size - 1 - c
    else:
        o = ascending(keys)
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = lists
    none = np.empty(0, np.int64)
    empty = np.empty(0)
    return (
        joined(none, a0, o),
        joined(none, a1, o),
        joined(none, a2, o),
        joined(none, a3, o),
        joined(none, a4, o),
        joined(none, a5, o),
        joined(empty, a6, o),
        joined(empty, a7, o),
        joined(none, a8, o),
    ), joined(np.empty(0, np.uint64), keys, o)


@njit(cache=True)
def places(keys, wanted):
    """Where each of the wanted keys stands among the keys, or would; both ascend."""
    at = np.empty(wanted.size, np.int64)
    place = 0
    for c in range(wanted.size):
        while place < keys.size and keys[place] < wanted[c]:
            place += 1
        at[c] = place
    return at


@njit(cache=True)
def pairs_of(family, i, j, start, dim, r):
    """The list of the pairs i, j of a family of hard particles."""
    m = i.size
    one = np.empty(m, np.int64)
    fam = np.empty(m, np.int64)
    p = np.empty(m, np.int64)
    q = np.empty(m, np.int64)
    dims = np.empty(m, np.int64)
    d = np.empty(m)
    sign = np.empty(m)
    for c in range(m):
        one[c] = 1
        fam[c] = family
        dims[c] = dim
        sign[c] = 1.0
        p[c] = start + dim * i[c]
        q[c] = start + dim * j[c]
        d[c] = r[i[c]] + r[j[c]]
    return one, fam, i, j, p, q, d, sign, dims


@njit(cache=True)
def near_list(x, reach, order, seed, static, static_keys, hard, radii, rank):
    """Listed constraints and near pairs in the order of the sweep, with their keys.

    hard (families, 4): family, start, particles, dim; radii and rank (by which pairs are ordered;
    empty: by label): those of all families one after the other.
    """
    lists = static
    keys = static_keys
    at = 0
    for u in range(hard.shape[0]):
        fam, start, n, dm = hard[u]
        r = radii[at : at + n]
        number = rank[at : at + n]
        at += n
        if n < 2:
            continue
        i, j = near_pairs(x, start, n, dm, r, reach)
        m = i.size
        k = np.empty(m, np.uint64)
        for c in range(m):
            if rank.size == 0:
                k[c] = sweep_key(order, seed, fam, i[c], j[c])
            else:
                a = number[i[c]]
                b = number[j[c]]
                k[c] = sweep_key(order, seed, fam, min(a, b), max(a, b))
        lists, keys = append(lists, keys, pairs_of(fam, i, j, start, dm, r), k, np.arange(m))
    return in_order(lists, keys)


@njit(cache=True)
def build(x, reach, order, seed, static, static_keys, hard, radii):
    """`near_list` in an order by labels."""
    return near_list(x, reach, order, seed, static, static_keys, hard, radii, np.empty(0, np.int64))


@njit(cache=True)
def rebuild(old, old_keys, mu, x, reach, order, seed, static, static_keys, hard, radii, rank):
    """A new list that carries the impulses of the old one; pairs that have acted since the last
    sample stay in it.

    (So an impulse is summed in the same order as over all pairs, and agrees with that to the last
    bit.)
    """
    lists, keys = near_list(x, reach, order, seed, static, static_keys, hard, radii, rank)
    at = places(keys, old_keys)
    gone = np.empty(old_keys.size, np.int64)
    m = 0
    for c in range(old_keys.size):
        if mu[c] != 0.0 and (at[c] == keys.size or keys[at[c]] != old_keys[c]):
            gone[m] = c
            m += 1
    if m > 0:
        lists, keys = append(lists, keys, old, old_keys, gone[:m])
        lists, keys = in_order(lists, keys)
        at = places(keys, old_keys)
    new = np.zeros(keys.size)
    for c in range(old_keys.size):
        if mu[c] != 0.0:
            new[at[c]] = mu[c]
    return lists, keys, new


@njit(cache=True, error_model="numpy")
def moved(x, base, first, dim, limit2):
    """Whether the particle at coordinate `first` is farther than sqrt(limit2) from where the list
    was built."""
    s = 0.0
    for c in range(first, first + dim):
        e = x[c] - base[c]
        s += e * e
    return s > limit2


@njit(cache=True)
def sweep_on(c, lists, rows, b, anchors, x, base, owner, limit2, mu):
    """Project on the constraints from c on, until the end or until a particle has left its
    certificate.

    owner (n, 2): first coordinate and dimension of the hard particle that a coordinate belongs to,
    -1 if none.
    Returns the next constraint, projections done, tied, and whether the certificate is broken.
    """
    kind, _, _, _, p, q, d, sign, dim = lists
    ptr, cols, vals, inv2 = rows
    work = 0
    tied = False
    while c < kind.size:
        m = 0.0
        if kind[c] == 1:
            m = project_pair(p[c], q[c], d[c], sign[c], dim[c], x)
        elif kind[c] == 0:
            m = project_row(p[c], x, ptr, cols, vals, inv2, b)
        else:
            m = project_anchor(p[c], q[c], d[c], sign[c], dim[c], x, anchors)
        c += 1
        if m == 0.0:
            continue
        work += 1
        tied = tied or m < 0.0
        mu[c - 1] += abs(m)
        broken = False
        if kind[c - 1] == 0:
            for e in range(ptr[p[c - 1]], ptr[p[c - 1] + 1]):
                o = owner[cols[e]]
                broken = broken or (o[0] >= 0 and moved(x, base, o[0], o[1], limit2))
        else:
            o = owner[p[c - 1]]
            broken = o[0] >= 0 and moved(x, base, o[0], o[1], limit2)
            if kind[c - 1] == 1 and not broken:
                o = owner[q[c - 1]]
                broken = o[0] >= 0 and moved(x, base, o[0], o[1], limit2)
        if broken:
            return c, work, tied, True
    return c, work, tied, False


@njit(cache=True)
def any_moved(x, base, hard, limit2):
    for u in range(hard.shape[0]):
        for i in range(hard[u, 2]):
            if moved(x, base, hard[u, 1] + i * hard[u, 3], hard[u, 3], limit2):
                return True
    return False


@njit(cache=True)
def march(
    f,
    b_of,
    a_of,
    moving,
    t,
    substeps,
    sweeps,
    x,
    static,
    rows,
    b,
    anchors,
    hard,
    radii,
    rank,
    owner,
    reach,
    order,
    seed,
):
    """As kernels.pbd.march, with near lists; also returns rebuilds and the longest list held."""
    K = t.size
    X = np.full((K, x.size), np.nan)
    R = np.full((K, x.size), np.nan)
    x, reac, v, base = x.copy(), np.zeros(x.size), np.empty(x.size), x.copy()
    ids = np.empty((64, 4), np.int64)
    values = np.empty(64)
    count = 0
    static_key = static_keys(static[1], order, seed)
    lists, keys = near_list(x, reach, order, seed, static, static_key, hard, radii, rank)
    mu = np.zeros(keys.size)
    most = 3 * hard[:, 2].sum() + static_key.size
    X[0] = x
    R[0] = reac
    work = 0
    status = OK
    rebuilds = 1
    peak = keys.size
    skin = reach
    calm = 0
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            f(now, x, v)
            for c in range(x.size):
                x[c] += h * v[c]
                v[c] = x[c]
            if not finite(x):
                return X, R, ids[:count], values[:count], work, NAN, now, rebuilds, peak
            if moving:
                after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
                b_of(after, b)
                a_of(after, anchors)
            broken = any_moved(x, base, hard, 0.2499 * skin * skin)
            inside = 0
            for _ in range(sweeps):
                c = 0
                last = np.uint64(0)
                while True:
                    if broken:
                        if (
                            inside > 4 and keys.size < most
                        ):  # a violent sweep: longer lists, fewer of them
                            skin *= 1.5
                        lists, keys, mu = rebuild(
                            lists,
                            keys,
                            mu,
                            x,
                            skin,
                            order,
                            seed,
                            static,
                            static_key,
                            hard,
                            radii,
                            rank,
                        )
                        for e in range(x.size):
                            base[e] = x[e]
                        rebuilds = rebuilds + 1
                        peak = max(peak, keys.size)
                        inside = inside + 1
                        if c > 0:
                            c = 0
                            while c < keys.size and keys[c] <= last:
                                c += 1
                    c, done, tied, broken = sweep_on(
                        c, lists, rows, b, anchors, x, base, owner, 0.2499 * skin * skin, mu
                    )
                    work += done
                    status = TIED if tied else status
                    if not broken:
                        break
                    last = keys[c - 1]
            calm = calm + 1 if inside <= 1 else 0
            if calm > 8 and skin > reach:  # the storm is over: short lists again
                skin = max(reach, skin / 1.5)
                calm = 0
            for c in range(x.size):
                reac[c] += x[c] - v[c]
        X[k + 1] = x
        R[k + 1] = reac
        ids, values, count = flush(k + 1, mu, lists[1], lists[2], lists[3], ids, values, count)
    return X, R, ids[:count], values[:count], work, status, t[K - 1], rebuilds, peak
