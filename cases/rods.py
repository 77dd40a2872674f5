"""Rods: n unit rods on a line are drawn to the origin and close up one by one.

    x_i' = -x_i + lam_{i-1,i} - lam_{i,i+1},   g_ij = |x_i - x_j| - 1 >= 0

Exact: neighbours alone can touch. A block of k touching rods moves as one; the contact forces cancel in its mean,
m' = -m. Blocks of k and l rods whose means are D apart at time s meet at  t = s + ln(2 D / (k + l)); the mean of
the new block is the weighted mean. Inside a block at rest relative to its mean the load behind the j-th rod is
lam_j = -(sum of the first j offsets) = j (k - j) / 2 at all times: a parabola that never vanishes, so blocks
never part, and the impulses are piecewise linear.

What it is for: n - 1 contacts in a known order, and chain reactions: one sweep at rest violates by about h n^2 / 8,
and the state error of the sweep grows like n^3 h.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SUITES = {"smoke": [{"n": 5}], "standard": [{"n": 5}, {"n": 10}], "full": [{"n": 2}, {"n": 30}]}
GOLDEN = 0.5 * (5.0 ** 0.5 - 1.0)


def start(n):
    """Spread unevenly, no two gaps alike, and not centred: a symmetric start would amplify rounding."""
    gaps = 0.2 + 0.8 * np.mod(GOLDEN * np.arange(1, n), 1.0)
    x = np.concatenate(([0.0], np.cumsum(1.0 + gaps)))
    return x - x.mean() + 0.3


def history(x0):
    """Epochs between merges: list of (start time, sizes of the blocks, their means at that time)."""
    time, sizes, means = 0.0, np.ones(len(x0)), np.array(x0)
    epochs = [(time, sizes, means)]
    while len(sizes) > 1:
        wait = np.log(2.0 * np.diff(means) / (sizes[1:] + sizes[:-1]))
        i = int(np.argmin(wait))
        time, means = time + wait[i], means * np.exp(-wait[i])
        weight = sizes[i] + sizes[i + 1]
        joined = (sizes[i] * means[i] + sizes[i + 1] * means[i + 1]) / weight
        sizes = np.concatenate((sizes[:i], [weight], sizes[i + 2:]))
        means = np.concatenate((means[:i], [joined], means[i + 2:]))
        epochs.append((time, sizes, means))
    return epochs


def offsets(sizes):
    """Positions of the rods relative to the mean of their block."""
    return np.concatenate([np.arange(k) - 0.5 * (k - 1) for k in sizes])


def loads(sizes):
    """Multiplier of each pair of neighbours, zero between blocks."""
    return np.concatenate([np.append(j * (k - j) / 2, 0.0) for k in sizes for j in [np.arange(1, k)]])[:-1]


def make(n: int = 5) -> Case:
    """n: number of rods, at least 2."""
    if n < 2:
        raise ValueError(f"n is {n!r}; at least 2 rods")
    x0 = start(n)
    epochs = history(x0)
    times = np.array([e[0] for e in epochs])

    def drift(xp):
        def f(t, x):
            return -x
        return f

    def exact(t):
        x = np.empty((len(t), n))
        for k, e in enumerate(np.searchsorted(times, t, side="right") - 1):
            s, sizes, means = epochs[e]
            x[k] = np.repeat(means * np.exp(s - t[k]), sizes.astype(int)) + offsets(sizes)
        return x

    def exact_impulse(t):
        ends = np.append(times[1:], np.inf)
        return sum(np.clip(t, s, end)[:, None] * loads(sizes) - s * loads(sizes)
                   for (s, sizes, _), end in zip(epochs, ends, strict=True))

    return Case(
        name="rods",
        problem=Complementarity(drift, (Distance(d=1.0, dim=1),)),
        x0=x0,
        t=np.linspace(0.0, 2.0, 21),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(times[1:]),
        contacts=tuple((0, i, i + 1) for i in range(n - 1)),
        substeps=min(40, max(8, n * n // 3)),          # the sweep needs about n^2 steps to see through a block
        also=("pbd[order=reverse]",),
    )
