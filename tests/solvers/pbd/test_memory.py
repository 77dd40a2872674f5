"""Memory of hard discs grows like N: pairs are never listed."""

import itertools
import json
import subprocess
import sys

import pytest

CODE = """
import json, resource, sys
import numpy as np, nsbench
from nsbench.solvers import get
def peak():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
# what is loaded once is not of a disc
get("pbd").prepare(nsbench.get_case("discs", n=50, box=True), 0.01)()
out = []
for n in (100, 1000, 10000, 100000):
    case = nsbench.get_case("discs", n=n, box=True)
    case = case.replace(t=np.linspace(0.0, 0.05, 3))
    before = peak()
    traj = get("pbd").prepare(case, 0.01)()
    out.append((n, peak() - before, traj.stats["contacts_peak"] - 4 * n))
print(json.dumps(out))
"""


@pytest.mark.long
def test_memory_and_lists_grow_like_the_number_of_discs():
    out = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=True
    ).stdout
    rows = json.loads(out.splitlines()[-1])
    for n, _, pairs in rows:
        assert pairs < 4 * n, f"{pairs / n:.1f} pairs a disc in the list at n = {n}"
    per_disc = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in itertools.pairwise(rows)]
    print(rows, per_disc)
    assert max(per_disc[1:]) < 5000, f"bytes for each further disc: {per_disc}"
