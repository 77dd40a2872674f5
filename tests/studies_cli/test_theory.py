"""The inequalities behind the bounds, in exact rational arithmetic."""

from fractions import Fraction

import numpy as np

from nsbench.studies.lemma import theory_check
from nsbench.studies.lemma.theory_check import (
    Instance,
    check_instance,
    count_violations,
    draw_instance,
    largest_ratio,
    sweep_exactly,
)


def test_no_inequality_fails_on_random_graphs():
    counts = count_violations(3, 0, 40)
    assert counts.pop("checked") == 40
    assert len(counts) == 11 and set(counts.values()) == {0}


def test_gram_matrices_are_exact_and_positive_semidefinite():
    for k in range(20):
        gram = draw_instance(np.random.default_rng(k)).gram
        assert all(gram[i][i] == 1 for i in range(len(gram)))
        values = np.array([[float(a) for a in row] for row in gram])
        assert np.linalg.eigvalsh(values)[0] > -1e-12


def test_an_order_that_skips_a_projection_is_noticed(monkeypatch):
    """A sweep that corrects too much breaks the identity of the energy: the check can fail."""

    def too_much(gram, gaps):
        c, _ = sweep_exactly(gram, gaps)
        c = [Fraction(3) * x for x in c]
        moved = [sum(a * b for a, b in zip(row, c, strict=True)) for row in gram]
        return c, [g + m for g, m in zip(gaps, moved, strict=True)]

    monkeypatch.setattr(theory_check, "sweep_exactly", too_much)
    one = [[Fraction(1)]]
    result = check_instance(Instance([(0, 1)], one, [Fraction(-1)], [Fraction(0)], [[0]]))
    assert not result["energy"] and not result["corrections"]


def test_climbing_finds_no_correction_above_its_limit():
    assert 0.6 < largest_ratio(0, 4, 200) <= 1.0
