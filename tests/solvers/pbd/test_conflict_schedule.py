"""The order of execution keeps the stated order of the constraints on every particle."""

import itertools

import numpy as np

from nsbench.compilation.factories import without_compilation
from nsbench.solvers.pbd.kernels.conflict_schedule import schedule


def test_no_constraint_overtakes_another_one_on_its_particle():
    rng = np.random.default_rng(5)
    n = 400
    m = 900
    i = rng.integers(0, n - 9, m).astype(np.int32)
    j = np.where(rng.random(m) < 0.1, -1, i + rng.integers(1, 9, m)).astype(np.int32)
    keys = rng.permutation(m).astype(np.uint64)
    row = (np.arange(n) // 20).astype(np.int32)
    place = np.empty(m, np.int32)
    queue = np.empty(2 * m, np.int32)
    after = np.empty(2 * m, np.int32)
    ends = np.empty(n + 1, np.int32)
    need = np.empty(m, np.int8)
    without_compilation(schedule)(i, j, keys, row, ends, queue, after, need, place)
    assert sorted(place) == list(range(m))
    for a in range(n):  # constraints on a particle, by key: each waits for the one before
        own = sorted(np.flatnonzero((i == a) | (j == a)), key=lambda c: keys[c])
        for c, d in itertools.pairwise(own):
            assert place[c] < place[d]
