"""Event-driven runs of Filippov systems that a test writes itself: the case, and its run."""

import numpy as np
from filippov_factories import entry

from nsbench import Case, solve

second = entry(1)  # switches where x_1 = 0


def filippov(problem, x0, T, k=41):
    return Case("test", problem, np.array(x0, float), np.linspace(0.0, T, k))


def run(case, **options):
    spec = ",".join(f"{k}={v}" for k, v in options.items())
    return solve(case, f"event_driven[{spec}]" if spec else "event_driven")
