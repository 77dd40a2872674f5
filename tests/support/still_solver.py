"""A solver file whose runs stay where the case starts, without options, under any name."""

SOLVER = '''"""A solver that was made for a test."""
from dataclasses import dataclass
import numpy as np
from nsbench.solvers import Claims, Trajectory


@dataclass(frozen=True)
class Still:
    {doc}
    accuracy, default, claims = "h", 0.01, Claims()

    def refuses(self, case):
        return None

    def prepare(self, case, h):
        {prepare}
        def run():
            {run}
            k = len(case.t)
            return Trajectory(case.t, np.tile(case.x0, (k, 1)), (), np.zeros((k, 0)), np.zeros((k, case.n)), stats={stats})
        return run


SOLVER = Still
'''


def solver(folder, name="still", doc='"""Stays where it is."""', prepare="", run="", stats="{}"):
    path = folder / f"{name}.py"
    path.write_text(SOLVER.format(doc=doc, prepare=prepare, run=run, stats=stats))
    return path
