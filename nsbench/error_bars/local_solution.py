"""Local solution of the constrained motion over an interval in which contacts close or open.

It is followed piece by piece, from one change of contacts to the next (kernels.local_piece). An
interval is divided into more pieces until their residual counts no longer beside the run's own
error.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from nsbench.error_bars.contact_rows import size
from nsbench.error_bars.kernels.case_rows import CLOSED
from nsbench.error_bars.kernels.cubic import QUARTERS
from nsbench.error_bars.shadow import Shadow, Stretch

PIECES = (1, 4)  # of an interval, beside those that events make
SMALL = 0.1  # of the run's error over the interval: a residual that needs no more pieces
MOST_PIECES = 200


@dataclass(frozen=True)
class LocalSolution:
    """Where a local solution ends: state (n,), bound of the integral of its residual, integral
    (n,) of the drift along it and its doubt, its pieces, and whether it got to the end of its
    interval.
    """

    state: np.ndarray
    residual: float
    drift: np.ndarray
    doubt: float
    pieces: list[Stretch]
    is_complete: bool


def local_solution(
    shadow: Shadow, t: float, H: float, y: np.ndarray, target: np.ndarray, most: int = MOST_PIECES
) -> LocalSolution:
    """Integrate over [t, t + H] from the state y (n,) of S, in at most so many pieces.

    target (n,): where the run went.
    """
    for pieces in PIECES:
        found = _in_pieces(shadow, t, H, y, pieces, most)
        error = size(target - found.state)
        if not found.is_complete or found.residual <= SMALL * error + CLOSED:
            break
    return found


def _in_pieces(
    shadow: Shadow, t: float, H: float, y: np.ndarray, pieces: int, most: int
) -> LocalSolution:
    ends = t + H * np.arange(1, pieces + 1) / pieces
    now = t
    closed: Collection[tuple] = ()
    total = np.zeros_like(y)
    unsure = 0.0
    at = 0
    found: list[Stretch] = []
    for _ in range(most):
        rows, piece = shadow.kernels.follow_piece(now, float(ends[at]) - now, y)
        closed = frozenset([rows.ids[k] for k in piece.closed.tolist()])
        found.append(
            Stretch(
                t=now,
                H=piece.length,
                states=piece.states,
                end=piece.end,
                ids=tuple([rows.ids[k] for k in piece.acting.tolist()]),
                loads=piece.loads,
                closed=closed,
                residual=np.empty((0, len(y))),
                slack=piece.slack,
            )
        )
        y = piece.end
        total += piece.along
        unsure += piece.doubt
        now += piece.length
        if not piece.is_cut or now >= ends[at]:
            now = float(ends[at])
            at += 1
            if at == pieces:
                break
    left = t + H - now if at < pieces else 0.0
    if left > 0.0:
        # too many events: the curve waits where it is for the rest of the interval
        f = shadow.drift(now, y)
        total += left * f
        found.append(_waiting(now, left, y, left * float(np.linalg.norm(f)), closed))
    residual = sum(s.slack for s in found)
    return LocalSolution(y, residual, total, unsure, found, left == 0.0)


def _waiting(t: float, H: float, y: np.ndarray, slack: float, closed) -> Stretch:
    loads = np.empty((len(QUARTERS), 0))
    no_residual = np.empty((0, len(y)))
    states = np.array([y] * 4)
    return Stretch(t, H, states, y, (), loads, frozenset(closed), no_residual, slack)
