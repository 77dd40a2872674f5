"""PBD with large steps, one projection at a time: its states, and the sweeps until no overlap.

A step moves all discs by the drift -x, then each overlapping pair is pushed apart to contact, one
pair after the other; both discs move by half the overlap. Later pairs overlap earlier ones again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RESOLVED = 1e-6  # overlap over the diameter at which sweeps are no longer counted
MAX_SWEEPS = 10_000


@dataclass(frozen=True)
class Frame:
    """Centres (n, 2), the pair that was projected last (None: none) and what happened."""

    x: np.ndarray
    pair: tuple[int, int] | None
    label: str


def all_pairs(n: int) -> list[tuple[int, int]]:
    """List the pairs of n discs in the order of the sweep."""
    return [(i, j) for i in range(n) for j in range(i + 1, n)]


def project_pair(x: np.ndarray, i: int, j: int, diameter: float) -> float:
    """Push discs i and j apart to contact, in place; returns the overlap that they had."""
    away = x[j] - x[i]
    length = float(np.linalg.norm(away))
    overlap = max(0.0, diameter - length)
    if overlap > 0.0:
        shift = away * (overlap / (2.0 * length))
        x[i] -= shift
        x[j] += shift
    return overlap


def largest_overlap(x: np.ndarray, diameter: float) -> float:
    """Return the largest overlap of two discs."""
    i, j = np.triu_indices(len(x), 1)
    return float(max(0.0, (diameter - np.linalg.norm(x[i] - x[j], axis=1)).max()))


def follow_step(
    x: np.ndarray, h: float, pairs: list[tuple[int, int]], diameter: float
) -> list[Frame]:
    """Follow one step of PBD: the start, the drift, and each projection in turn."""
    x = np.array(x)
    frames = [Frame(x.copy(), None, "start")]
    x -= h * x
    frames.append(Frame(x.copy(), None, f"drift, h = {h:g}"))
    for i, j in pairs:
        overlap = project_pair(x, i, j, diameter)
        label = f"{i + 1}-{j + 1}: {overlap:.2g}" if overlap else f"{i + 1}-{j + 1}: open"
        frames.append(Frame(x.copy(), (i, j), label))
    return frames


def count_sweeps(
    x: np.ndarray, h: float, pairs: list[tuple[int, int]], diameter: float
) -> tuple[float, int]:
    """Return the overlap over that of the drift after one sweep, and the sweeps to RESOLVED."""
    x = np.array(x)
    x -= h * x
    first = largest_overlap(x, diameter)
    after_one = 0.0
    for sweeps in range(1, MAX_SWEEPS + 1):
        for i, j in pairs:
            project_pair(x, i, j, diameter)
        overlap = largest_overlap(x, diameter)
        if sweeps == 1:
            after_one = overlap / first if first else 0.0
        if overlap <= RESOLVED * diameter:
            return after_one, sweeps
    return after_one, MAX_SWEEPS
