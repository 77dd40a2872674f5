"""Constants of one sweep: search below the exact value, the exact value below the bound."""

import numpy as np
import pytest

from nsbench.compilation.decorators import python_entry
from nsbench.studies.lemma.adversarial_search import (
    distinct_contacts,
    search_fixed_order,
    search_sum,
    search_violation,
    store_rows,
)
from nsbench.studies.lemma.exact_constant import enumerate_violation, exact_violation
from nsbench.studies.lemma.kernels import worst_case
from nsbench.studies.lemma.proven_bound import (
    bound_corrections,
    bound_equal_discs,
    bound_sum,
    bound_violation,
    norm_bound,
)
from nsbench.studies.lemma.worst_geometry import find_worst_geometry
from nsbench.studies.packings.contact_graphs import (
    chain,
    close_packed,
    flower,
    grow,
    grow_from,
    hexagon,
    star,
)
from nsbench.studies.packings.linear_sweep import longest_increasing_path, sweep

evaluate = python_entry(worst_case.evaluate)

SECONDS = 20.0  # limit of HiGHS, far above what these packings take
TOLERANCE = 1e-6  # relative, of HiGHS


def all_contacts(graph):
    return list(range(len(graph.pairs)))


@pytest.mark.parametrize("graph", [chain(4), star(3, 1)], ids=lambda g: g.name)
def test_two_exact_methods_agree(graph):
    found = exact_violation(graph.gram, graph.distances(), all_contacts(graph), SECONDS)
    assert found.proven
    assert found.value == pytest.approx(enumerate_violation(graph.gram), rel=TOLERANCE)


def test_two_exact_methods_agree_on_one_order_with_positive_entries():
    """Two contacts of one disc at 60 degrees close each other: max(0, 1 - q) matters."""
    graph = flower(5)
    few = np.ix_(range(6), range(6))
    gram = graph.gram[few]
    order = np.array([3, 0, 5, 1, 4, 2])
    distance = graph.distances()[few]
    found = exact_violation(gram, distance, list(range(6)), SECONDS, order)
    assert found.proven and (gram[gram < 1.0] > 0.1).any()
    assert found.value == pytest.approx(enumerate_violation(gram, order), rel=TOLERANCE)


@pytest.mark.parametrize(
    "graph, value",
    [(chain(3), 3 / 4), (chain(4), 3 / 2), (chain(6), 2.0), (chain(8), 9 / 4)],
    ids=lambda v: getattr(v, "name", ""),
)
def test_rows_of_discs_have_the_constant_of_their_worst_order(graph, value):
    """Both halves are swept towards a contact that was projected first: sums of halves."""
    found = exact_violation(graph.gram, graph.distances(), all_contacts(graph), SECONDS)
    assert found.proven and found.value == pytest.approx(value, rel=TOLERANCE)


@pytest.mark.long
@pytest.mark.parametrize(
    "graph",
    [chain(7), star(3, 2), flower(5), grow(7, 3), grow(6, 1, spread=2.0), grow(6, 0, dim=3)],
    ids=lambda g: g.name,
)
def test_search_is_below_the_exact_value_and_that_below_the_bound(graph):
    gram = graph.gram
    distance = graph.distances()
    kinds = distinct_contacts(gram, distance)
    exact = exact_violation(gram, distance, kinds, SECONDS)
    found = search_violation(gram, distance, 0, 2, 5000).value
    assert exact.proven
    assert found <= exact.value * (1.0 + TOLERANCE)
    assert found >= exact.value * 0.99  # and it is no idle search
    assert exact.value <= bound_violation(gram, distance, kinds)


@pytest.mark.long
def test_search_is_below_the_bounds_on_larger_packings():
    for graph in (hexagon(2), close_packed(13), grow(20, 0)):
        gram = graph.gram
        distance = graph.distances()
        kinds = distinct_contacts(gram, distance)
        worst = search_violation(gram, distance, 0, 1, 5000)
        assert 0.5 < worst.value <= bound_violation(gram, distance, kinds)
        assert search_sum(gram, distance, 0, 1, 5000).value <= bound_sum(gram, distance, kinds)


def test_a_worst_case_is_a_sweep_that_anybody_can_repeat():
    graph = hexagon(1)
    worst = search_violation(graph.gram, graph.distances(), 0, 2, 5000)
    assert worst.gaps.min() >= -1.0
    result = sweep(graph.gram, worst.order, worst.gaps)
    assert result.violations.max() == worst.value
    total = search_sum(graph.gram, graph.distances(), 0, 2, 5000)
    left = sweep(graph.gram, total.order, total.gaps).violations
    assert left.sum() / np.maximum(-total.gaps, 0.0).sum() == total.value


def test_random_sweeps_stay_below_the_bounds_of_corrections_and_violations():
    graph = grow(14, 5)
    gram = graph.gram
    distance = graph.distances()
    caps = bound_corrections(gram, distance)
    constant = bound_violation(gram, distance, all_contacts(graph))
    rng = np.random.default_rng(0)
    for _ in range(200):
        gaps = rng.choice([-1.0, -0.5, 0.0, 1.0], len(gram))
        result = sweep(gram, rng.permutation(len(gram)), gaps)
        assert np.all(result.corrections <= caps)
        assert result.violations.max() <= constant


def test_the_uniform_bound_is_above_the_bound_of_every_packing_of_equal_discs():
    for rings in (1, 2, 3):
        graph = hexagon(rings)
        distance = graph.distances()
        kinds = distinct_contacts(graph.gram, distance)
        assert bound_violation(graph.gram, distance, kinds) < bound_equal_discs()


def test_what_the_uniform_bound_assumes_of_the_contacts_of_a_disc_holds():
    """Up to six contacts, 60 degrees apart: sums of |cos| at most 3, of squares at most 3/2."""
    rng = np.random.default_rng(1)
    for _ in range(2000):
        spare = rng.dirichlet(np.full(6, 0.3))
        others = int(rng.integers(1, 6))
        rest = 2.0 * np.pi - (others + 1) * np.pi / 3.0
        steps = np.pi / 3.0 + rest * spare[: others + 1] / spare[: others + 1].sum()
        cosines = np.cos(np.cumsum(steps[:-1]))
        assert np.abs(cosines).sum() <= 3.0 + 1e-12
        assert (np.minimum(cosines, 0.0) ** 2).sum() <= 1.5 + 1e-12


def test_the_norm_bound_is_above_the_norm():
    rng = np.random.default_rng(2)
    for _ in range(50):
        matrix = rng.random((6, 6)) * (rng.random((6, 6)) < 0.4)
        matrix = matrix + matrix.T
        norm = np.linalg.norm(matrix, 2)
        assert norm * (1.0 - 1e-12) <= norm_bound(matrix) <= 1.5 * norm + 1e-12


def test_one_order_of_a_hexagon_has_its_exact_value():
    graph = hexagon(1)
    order = np.random.default_rng(4).permutation(len(graph.pairs))
    exact = exact_violation(graph.gram, graph.distances(), all_contacts(graph), SECONDS, order)
    assert search_fixed_order(graph.gram, order) == pytest.approx(exact.value, rel=TOLERANCE)


def test_packings_touch_where_they_say_and_nowhere_overlap():
    grown = (grow(12, 0, 0.8, 2.0), grow(9, 1, dim=3))
    for graph in (hexagon(2), flower(9), close_packed(13), *grown):
        i, j = np.triu_indices(len(graph.centres), 1)
        gap = np.linalg.norm(graph.centres[i] - graph.centres[j], axis=1)
        gap -= graph.radii[i] + graph.radii[j]
        touching = {(a, b) for a, b in graph.pairs.tolist()}
        closed = {(a, b) for a, b in zip(i[abs(gap) < 1e-9], j[abs(gap) < 1e-9], strict=True)}
        assert touching == closed and gap.min() > -1e-9
        assert np.linalg.eigvalsh(graph.gram)[0] > -1e-12


def test_a_sweep_along_a_row_is_one_increasing_path():
    gram = chain(6).gram
    assert longest_increasing_path(gram, np.arange(5)) == 5
    assert longest_increasing_path(gram, np.array([0, 2, 4, 1, 3])) == 2


def test_the_search_over_geometry_finds_worse_than_a_row():
    found = find_worst_geometry(5, 27, 60, SECONDS, 6)
    assert found["search"] > 1.75  # of five discs in a row
    assert found["exact"] is None or found["search"] <= found["exact"]
    assert found["search"] <= found["bound"]


def test_one_seed_moves_one_disc_and_those_that_touch_it():
    first = grow_from([1, 2, 3, 4])
    again = grow_from([1, 2, 3, 5])
    assert np.array_equal(first.centres[:3], again.centres[:3])
    assert not np.array_equal(first.centres[3], again.centres[3])


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 0, 1, 2)])
def test_two_exact_methods_agree_where_contacts_are_opened_wider_than_violated(order):
    """Two normals at right angles move 2 by sqrt 2 > 1, and 3, opposite to it, as far back."""
    diagonal = np.sqrt([0.5, 0.5])
    normals = np.array([[1.0, 0.0], [0.0, 1.0], diagonal, -diagonal])
    gram = normals @ normals.T
    found = exact_violation(gram, 1.0 - np.eye(4), list(range(4)), SECONDS, np.array(order))
    expected = enumerate_violation(gram, np.array(order))
    assert found.proven and expected > 1.4
    assert found.value == pytest.approx(expected, rel=TOLERANCE)
    assert found.upper == pytest.approx(expected, rel=1e-5)


def test_the_compiled_sweep_is_the_sweep():
    rng = np.random.default_rng(11)
    for graph in (hexagon(1), grow(10, 2, 0.9, 2.0)):
        gram = graph.gram
        m = len(gram)
        rows = store_rows(gram)
        for _ in range(30):
            order = rng.permutation(m)
            active = rng.random(m) < 0.7
            gaps = np.zeros(m)
            c = np.zeros(m)
            for k in order:
                q = gram[k] @ c
                gaps[k] = -1.0 if active[k] else max(-1.0, -q)
                c[k] = max(0.0, -(gaps[k] + q))
            after = sweep(gram, order, gaps).gaps
            u = np.ones(m)
            for target in range(m):
                value = evaluate(rows.ptr, rows.cols, rows.vals, u, target, order, active)
                assert value == pytest.approx(-after[target], abs=1e-12)


def test_a_sweep_projects_in_turn_and_never_pulls():
    result = sweep(chain(4).gram, np.array([1, 0, 2]), np.array([-1.0, -1.0, 2.0]))
    assert result.corrections == pytest.approx([1.5, 1.0, 0.0])
    assert result.gaps == pytest.approx([0.0, -0.75, 1.5])
