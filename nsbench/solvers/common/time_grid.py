"""Grid of a fixed-step method over the sample times of a case, and interpolation on that grid.

A fixed-step method never passes the step h to its time loop. h becomes a number of equal steps for
each interval between recorded times, and the loop computes each step anew:

    substeps[k] = ceil((t[k+1] - t[k]) / h),    h_k = (t[k+1] - t[k]) / substeps[k] <= h

so that steps end exactly at the samples. `Grid.h` is the largest h_k, which the row of a run holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case.scale import span_text


SHORTEST_BLOCK = 4  # steps between recorded states
RECORDS = 256  # of a run beside its samples, at most
FEWEST_RECORDS = 32
LARGEST_STATE = 700  # coordinates of a state that is recorded between samples
MOST_NUMBERS = 8_000  # coordinates of all records: error bars cost about as much as these


def check_positive(name: str, value: object) -> float:
    """Return `value` as a float; ValueError if it is not positive and finite."""
    try:
        v = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}; a number is needed") from None
    if not (np.isfinite(v) and v > 0):
        raise ValueError(f"{name} is {v!r}; positive and finite is needed")
    return v


@dataclass(frozen=True)
class Grid:
    """Recorded times, and the number of equal steps from each to the next.

    t (K,): recorded times. substeps (K-1,): steps from one to the next. h: the largest step taken.
    aligned: whether the recorded times are the sample times of the case; if not, results are read
    off the polygon through the recorded states (see `sample`).
    """

    t: np.ndarray
    substeps: np.ndarray
    h: float
    aligned: bool


def grid(t: np.ndarray, h: float | np.ndarray, last: bool = False, states: int = 0) -> Grid:
    """Return the grid of steps of at most h for the sample times t (k,).

    h: one length, or one (k - 1,) for each interval between samples. last: record the state before
    the last step to each sample as well. states: coordinates of a state, to record some states
    between the samples too (see `_block`); 0: none. A step that fits between samples divides every
    spacing; a longer one passes over samples in steps of exactly h, the last one shortened, and
    samples are read off the polygon. Raises ValueError if h is not positive, needs more than 2e9
    steps, or is below the rounding of t.
    """
    spacing = np.diff(t)
    if np.ndim(h):
        h = np.minimum(h, spacing)
        least = check_positive("h", h.min())
    else:
        least = check_positive("h", h)
    if np.all(h <= spacing * (1 + 1e-9)):
        n = substeps(spacing, h)
        if not float(n.sum()) <= 2e9:
            raise ValueError(
                f"h = {span_text(least, 6)} needs {float(n.sum()):.3g} steps; at most 2e9 are taken"
            )
        if least < 4 * np.spacing(np.abs(t).max()):
            raise ValueError(
                f"h = {span_text(least, 6)} is below the rounding of t = {np.abs(t).max():g}, "
                "where times are "
                f"{span_text(np.spacing(np.abs(t).max()), 2)} apart"
            )
        n = n.astype(np.int64)
        steps = float((spacing / n).max())
        block = _block(n, states)
        if not last and n.max() <= block:
            return Grid(np.array(t), n, steps, True)
        return _recording(t, n, block, last, steps)
    span = t[-1] - t[0]
    n = max(1, int(np.ceil(span / h * (1 - 1e-9))))
    nodes = np.append(t[0] + h * np.arange(n), t[-1])
    return Grid(nodes, np.ones(n, np.int64), float(min(h, span)), False)


def substeps(spacing: np.ndarray, h: float | np.ndarray) -> np.ndarray:
    """Return how many steps of at most h divide each spacing (k - 1,): whole numbers, as floats."""
    return np.maximum(1.0, np.ceil(spacing / h * (1 - 1e-9)))


def _block(n: np.ndarray, states: int) -> int:
    """Return how many steps are made between recorded states, of n (k - 1,) between samples.

    At least SHORTEST_BLOCK, so that recording costs little beside the steps; so many that at most
    about RECORDS are recorded in all, fewer of large states.
    """
    longest = int(n.max())
    if not states or states > LARGEST_STATE:
        return longest
    records = int(np.clip(MOST_NUMBERS // states, FEWEST_RECORDS, RECORDS))
    return max(SHORTEST_BLOCK, -(-int(n.sum()) // records))


def _recording(t, n, block, last, h) -> Grid:
    """Return the same steps with times recorded every `block` steps between samples, as evenly as
    whole numbers allow; last: and the times before the last step to each sample."""
    times = [t[:1]]
    steps = []
    for begin, end, m in zip(t[:-1], t[1:], n.tolist(), strict=True):
        parts = -(-m // block)
        done = [m * (p + 1) // parts for p in range(parts)]
        if last and m > 1 and m - 1 not in done:
            done.insert(-1, m - 1)
        # the sample itself is recorded at its own time, to the bit
        times.append([begin + c * ((end - begin) / m) for c in done[:-1]])
        times.append([end])
        steps.append(np.diff(done, prepend=0))
    # with `last`, samples are read off even where nothing but they is recorded
    aligned = not last and all(len(s) == 1 for s in steps)
    return Grid(np.concatenate(times), np.concatenate(steps).astype(np.int64), h, aligned)


def between_samples(
    t: np.ndarray, g: Grid, x: np.ndarray, impulse: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return times (j,), states (j, n) and impulses (j, m) of the recorded times that are no
    sample times t (k,), as `Trajectory.between` holds them; None where there are none."""
    at = np.minimum(np.searchsorted(t, g.t), len(t) - 1)
    others = t[at] != g.t
    return (g.t[others], x[others], impulse[others]) if others.any() else None


def last_steps(t: np.ndarray, g: Grid, impulse: np.ndarray) -> dict[str, np.ndarray]:
    """Return the multipliers of the last step before each sample time t (k,).

    g: grid(t, h, last=True); impulse (K, m): cumulative, at its recorded times. Returns lam (k, m)
    and lam_h (k,), the lengths of those steps, as arguments of a Trajectory; {} where steps are
    longer than the spacing of the samples.
    """
    at = np.searchsorted(g.t, t)
    if g.aligned or not (
        at[-1] < len(g.t) and np.array_equal(g.t[at], t) and np.all(g.substeps[at[1:] - 1] == 1)
    ):
        return {}
    h = np.append(np.nan, g.t[at[1:]] - g.t[at[1:] - 1])
    lam = np.full((len(t), impulse.shape[1]), np.nan)
    lam[1:] = (impulse[at[1:]] - impulse[at[1:] - 1]) / h[1:, None]
    return {"lam": lam, "lam_h": h}


def sample(t: np.ndarray, nodes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the polygon through (nodes (K,), values (K, n)) at the times t (k,): (k, n)."""
    return samples(t, nodes, values)[0]


def samples(t: np.ndarray, nodes: np.ndarray, *values: np.ndarray) -> list[np.ndarray]:
    """Return the polygons through (nodes (K,), each of values (K, n)) at the times t (k,)."""
    i = np.searchsorted(nodes, t, side="right") - 1
    i = np.maximum(np.minimum(i, len(nodes) - 2), 0)
    start = nodes[i]
    w = ((t - start) / (nodes[i + 1] - start))[:, None]
    rest = 1.0 - w
    # a node has its value whatever its neighbour is
    at_start = np.flatnonzero(w == 0.0)
    at_end = np.flatnonzero(w == 1.0)
    out = []
    for v in values:
        mean = rest * v[i] + w * v[i + 1]
        mean[at_start] = v[i[at_start]]
        mean[at_end] = v[i[at_end] + 1]
        out.append(mean)
    return out
