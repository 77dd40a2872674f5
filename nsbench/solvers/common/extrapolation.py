"""Richardson extrapolation: combine runs at accuracies e, e/2, e/4, ... so that powers of e cancel.

Source: Richardson 1911; Hairer, Norsett & Wanner I, II.9.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nsbench.case import Case
from nsbench.error_bars import Bars, ErrorBars, error_bars
from nsbench.trajectory import Status, Trajectory


def weights(times: int) -> np.ndarray:
    """Return the weights (times + 1,) of the runs with e, e/2, ..., e/2^times.

    Their sum is 1, and e, ..., e^times cancel.

    Once: 2 x(e/2) - x(e); twice: (x(e) - 6 x(e/2) + 8 x(e/4)) / 3. Source: Hairer, Norsett & Wanner
    I, II.9.
    """
    w = np.array([1.0])
    for power in range(1, times + 1):
        r = 2.0**power
        w = (r * np.append(0.0, w) - np.append(w, 0.0)) / (r - 1.0)
    return w


def combined(
    runs: list[Trajectory],
    h: float,
    case: Case | None = None,
    finer: Callable[[], Trajectory] | None = None,
) -> Trajectory:
    """Return the extrapolated trajectory of runs at halved accuracies.

    Impulses are those of the contacts that acted in any of them.

    Its states are not feasible, nor its multipliers of one sign, to better than their error. A run
    that failed fails it, with the first sentence; work is added up. stats["spread"]: the largest
    difference from the same extrapolation with one level less (from the last run, for two), an
    estimate of that one's error. case, finer: for error bars, what was run, and what makes the run
    at half the last accuracy.
    """
    w = weights(len(runs) - 1)
    last = weights(len(runs) - 2)
    for r in runs:
        if len(r.t) == 0:  # refused: there are no samples
            return r
    contacts = tuple(sorted({c for r in runs for c in r.contacts}))
    impulses = [_columns(r, contacts) for r in runs]
    x = _sum(w, [r.x for r in runs])
    before = _sum(last, [r.x for r in runs[1:]])
    with np.errstate(invalid="ignore"):
        spread = float(np.abs(x - before).max(initial=0.0))
    stats = _work([r.stats for r in runs]) | {"h": h, "spread": spread}
    bad = next((r.status for r in runs if not r.status.ok), Status())
    reaction = _sum(w, [r.reaction for r in runs])
    bars = ErrorBars(lambda: _bars(case, runs, finer(), (x, reaction))) if finer else None
    return Trajectory(
        runs[0].t,
        x,
        contacts,
        _sum(w, impulses),
        reaction,
        bad,
        (),
        stats,
        runs[0].lam_time,
        between=_between(runs[-1], contacts),
        resolution=_resolution(runs),
        bound=bars if runs[0].reaction.size else None,
    )


# An error of order p changes by 1 - 2^-p of itself when all accuracies are halved: by a half at
# least. The difference is doubled, so that it is at least the error wherever the order is one.
DOUBLED = 2.0
# Of a run's own error bars, which are at most some times its error, the least share by which an
# extrapolation that is right moves it
MOVED = 0.25


def _bars(
    case: Case, runs: list[Trajectory], last: Trajectory, found: tuple[np.ndarray, np.ndarray]
) -> Bars:
    """Return error bars of an extrapolation: DOUBLED times its distance to that of halved
    accuracies.

    last: the run that this takes; found: the extrapolated state and reaction, each (k, n). All runs
    may err alike where none is near its limit yet, as where all have landed and the exact motion
    has not. The finest run has error bars of its own; at samples where its state is moved by less
    than MOVED of them, the extrapolation is not confirmed: they and the distance moved are taken,
    and for the reaction where that is not confirmed either.
    At a sample the largest so far is taken: two extrapolations can cross by chance.
    """
    t = runs[0].t
    if not last.status.ok or len(last.t) != len(t):
        why = "The run with half the last step, which error bars take, did not reach its end."
        return Bars.none(t, why)
    own = error_bars(case, runs[-1])
    states = [r.x for r in (*runs, last)]
    reactions = [r.reaction for r in (*runs, last)]
    unconfirmed = _moves_less(found[0], states[-2], own.state)
    state = _bar(found[0], states, unconfirmed, own.state)
    # a reaction may be exact where the state is not, and have an error where a state is held
    unconfirmed &= _moves_less(found[1], reactions[-2], own.reaction)
    push = _bar(found[1], reactions, unconfirmed, own.reaction)
    return Bars(t, state, push, np.full(len(t), np.nan))


def _moves_less(found: np.ndarray, finest: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Is the finest run moved by less than MOVED of its error bars, at each sample (k,)?"""
    return np.linalg.norm(found - finest, axis=1) < MOVED * own


def _bar(found: np.ndarray, runs: list[np.ndarray], unconfirmed, own: np.ndarray) -> np.ndarray:
    """Return the error bars (k,) of an extrapolation (k, n) of all runs (k, n) but the last.

    own (k,): those of the finest that is extrapolated, which count where it is `unconfirmed` (k,).
    """
    halved = DOUBLED * np.linalg.norm(found - _sum(weights(len(runs) - 2), runs[1:]), axis=1)
    from_own = own + np.linalg.norm(found - runs[-2], axis=1)
    bar = np.where(unconfirmed, np.maximum(halved, from_own), halved)
    return np.maximum.accumulate(bar)


def _between(finest, contacts):
    """Return what the finest run passed between the samples: for checks of switches alone, whose
    sizes count; constraints need the extrapolated states."""
    return finest.between if finest.contacts == contacts and not finest.reaction.size else None


def _resolution(runs):
    """Return the resolution of an extrapolation: the step asked for, the thinnest layer."""
    first = runs[0].resolution
    last = runs[-1].resolution
    return replace(last, step=first.step) if first and last else None


def _sum(w, arrays):
    return sum(a * b for a, b in zip(w, arrays, strict=True))


def _columns(run, contacts):
    at = {c: k for k, c in enumerate(contacts)}
    out = np.zeros((len(run.t), len(contacts)))
    out[:, [at[c] for c in run.contacts]] = run.impulse
    out[~np.isfinite(run.x).all(axis=1)] = np.nan
    return out


def _work(stats: list[dict]) -> dict:
    """Add up the counts; of other values take that of the finest run, or the largest."""
    out = dict(stats[-1])
    for name, value in stats[-1].items():
        values = [s.get(name, 0) for s in stats]
        if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
            out[name] = max(values) if name.endswith("_peak") else sum(values)
        elif isinstance(value, float):
            out[name] = max(values)
    return out
