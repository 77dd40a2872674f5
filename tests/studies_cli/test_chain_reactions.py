"""Chain reactions: reach below its bound, and independent of the length of a row."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from nsbench.studies.chain.figures import draw_decay
from nsbench.studies.chain.large_steps import (
    all_pairs,
    count_sweeps,
    follow_step,
    largest_overlap,
    project_pair,
)
from nsbench.studies.chain.travel import (
    THRESHOLD,
    bound_reach,
    corrections_by_distance,
    measure_travel,
)
from nsbench.studies.packings.contact_graphs import chain, grow, hexagon
from nsbench.studies.packings.contact_orders import colour_contacts, named_orders


def test_a_row_passes_on_half_at_every_contact():
    graph = chain(9)
    values = corrections_by_distance(graph, np.arange(8))
    assert values == pytest.approx(0.5 ** np.arange(8))


def test_the_reach_does_not_grow_with_the_length_of_a_row():
    reaches = [measure_travel(chain(n), np.arange(n - 1)).reach for n in (20, 40)]
    assert reaches == [9, 9]


@pytest.mark.parametrize("graph", [hexagon(2), grow(12, 0)], ids=lambda g: g.name)
def test_the_reach_is_below_its_bound_and_the_longest_path(graph):
    for order in named_orders(graph).values():
        travel = measure_travel(graph, order)
        assert travel.reach <= min(bound_reach(graph), travel.path - 1)


def test_the_bound_of_the_reach_is_where_the_proven_decay_meets_the_threshold():
    graph = hexagon(1)
    norm = np.linalg.norm(np.abs(graph.gram) - np.eye(12), 2)

    def distance(mu):
        return np.log(2.0 / ((1.0 - norm * np.expm1(mu)) * THRESHOLD)) / mu

    best = minimize_scalar(distance, bounds=(1e-3, np.log1p(1.0 / norm) - 1e-3), method="bounded")
    assert bound_reach(graph) == np.floor(best.fun)


def test_contacts_of_one_colour_share_no_disc():
    graph = hexagon(2)
    colours = colour_contacts(graph.gram)
    for colour in set(colours.tolist()):
        pairs = graph.pairs[colours == colour]
        assert len(np.unique(pairs)) == pairs.size


def test_a_projection_closes_its_own_gap_and_keeps_the_mean():
    x = np.array([[0.0, 0.0], [1.0, 0.5], [4.0, 0.0]])
    mean = x.mean(axis=0)
    overlap = project_pair(x, 0, 1, 2.0)
    assert overlap == pytest.approx(2.0 - np.hypot(1.0, 0.5))
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(2.0)
    assert x.mean(axis=0) == pytest.approx(mean)


def test_frames_show_start_drift_and_every_projection():
    x = hexagon(1).centres
    frames = follow_step(x, 0.1, all_pairs(7), 2.0)
    assert len(frames) == 2 + 21 and frames[0].x == pytest.approx(x)
    assert frames[1].x == pytest.approx(0.9 * x)


def test_sweeps_end_without_overlap():
    x = chain(4).centres - 3.0
    left, sweeps = count_sweeps(x, 0.2, all_pairs(4), 2.0)
    assert 0.0 < left < 2.0 and 1 < sweeps < 100
    assert largest_overlap(chain(4).centres, 2.0) == 0.0


def test_labels_of_logarithmic_axes_are_plain_text():
    svg = draw_decay([("a row", {"along": 0.5 ** np.arange(12.0)})])
    assert "mathdefault" not in svg and ">0.01<" in svg and "along" in svg
