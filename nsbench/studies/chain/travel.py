"""How far one violation travels: the linearised sweep from a single violated contact.

g_j = -1 at one contact j, all other contacts just closed (g = 0). Contact l takes part in the chain
reaction if its correction is at least THRESHOLD; the reach is the largest distance from j in the
dual graph of a contact that does. Proven (docs/studies.md):

    c_l <= 2 e^(-mu dist(l, j)) / (1 - K (e^mu - 1))    for any mu with K (e^mu - 1) < 1,

so that the reach is bounded whatever the order and the number of discs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.studies.packings.contact_graphs import ContactGraph
from nsbench.studies.packings.linear_sweep import longest_increasing_path, sweep

THRESHOLD = 1e-3  # of the violation: corrections below it are not counted
DECAYS = np.linspace(0.0, 1.0, 201)[1:]  # mu


@dataclass(frozen=True)
class Travel:
    """The chain reactions of one packing in one order, over all contacts j as the violated one.

    reach: largest of all. mean_reach: mean over j. moved: mean number of contacts that take part.
    left: largest violation left. path: longest increasing path of the order.
    """

    reach: int
    mean_reach: float
    moved: float
    left: float
    path: int


def measure_travel(graph: ContactGraph, order: np.ndarray) -> Travel:
    """Measure the chain reactions from every contact of a packing in one order."""
    gram = graph.gram
    distance = graph.distances()
    reach = []
    moved = []
    left = []
    for j in range(len(gram)):
        result = sweep(gram, order, np.where(np.arange(len(gram)) == j, -1.0, 0.0))
        taking_part = result.corrections >= THRESHOLD
        reach.append(int(distance[j][taking_part].max()))
        moved.append(int(taking_part.sum()))
        left.append(float(result.violations.max()))
    return Travel(
        max(reach),
        float(np.mean(reach)),
        float(np.mean(moved)),
        max(left),
        longest_increasing_path(gram, order),
    )


def corrections_by_distance(graph: ContactGraph, order: np.ndarray) -> np.ndarray:
    """Return the largest correction at each distance 0, 1, ... from any one violated contact."""
    gram = graph.gram
    distance = graph.distances()
    shells = np.arange(int(distance[np.isfinite(distance)].max()) + 1)
    largest = np.zeros(len(shells))
    for j in range(len(gram)):
        gaps = np.where(np.arange(len(gram)) == j, -1.0, 0.0)
        c = sweep(gram, order, gaps).corrections
        here = np.array([c[distance[j] == d].max(initial=0.0) for d in shells])
        largest = np.maximum(largest, here)
    return largest


def bound_reach(graph: ContactGraph) -> int:
    """Return the proven bound of the reach in any order."""
    gram = graph.gram
    norm = np.linalg.norm(np.abs(gram) - np.eye(len(gram)), 2)
    room = 1.0 - norm * np.expm1(DECAYS)
    decay = DECAYS[room > 0.0]
    room = room[room > 0.0]
    # smallest d with 2 e^(-mu d) / room < THRESHOLD, less one
    distance = np.log(2.0 / (room * THRESHOLD)) / decay
    return int(np.floor(distance.min()))
