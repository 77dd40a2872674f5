"""The text of a solver file whose runs stay where the case starts, after doing what a test
wants."""

import textwrap

TEXT = '''"""A solver that was made for a test."""
import ctypes, locale, os, random, re, signal, sys, time, warnings
from dataclasses import dataclass
import numpy as np
from nsbench.solvers import Claims, Status, Trajectory
{before}
@dataclass(frozen=True)
class Made:
    """Made for a test."""
    how: str = "{how}"
    accuracy, default, claims = "h", 0.01, Claims()

    def refuses(self, case):
        return None

    def prepare(self, case, h):
        def run():
{run}
            k = len(case.t)
            return Trajectory(case.t, np.tile(case.x0, (k, 1)), (), np.zeros((k, 0)), np.zeros((k, case.n)), stats={stats})
        return run

SOLVER = Made
'''


def solver(run: str, how: str = "fine", before: str = "", stats: str = "{}") -> str:
    """run: statements that a run begins with (they see self.how, case and h); how: its default;
    before: statements of the module; stats: an expression."""
    return TEXT.format(
        run=textwrap.indent(textwrap.dedent(run), 12 * " "), how=how, before=before, stats=stats
    )
