"""Maps of status and error over step and difficulty, for every method that takes the scene.

A difficulty is the stiffness of the drift, the number of rods or discs, the angle of a corner, the
height of a stack, or the number of sweeps in a step of PBD. Methods with a step have one cell for
each step, any other (tolerance, stiffness of a penalty) one cell with its default.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.measure.context import MeasureContext
from nsbench.studies.plateau.scenes import find_scene
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.ladders import context_of_truth

DIVISORS = (1, 4, 16, 64)  # steps between samples
OWN = "own"  # the column of methods without a step
UNLISTED = ("solve_ivp", "nosnoc")  # modes by hand, or an extra: not for scenes of any parameter


@dataclass(frozen=True)
class Map:
    """One map: name, words for its difficulty, the scenes by difficulty, small and full.

    options: specs of the methods by difficulty, where it is an option of theirs; else none, and
    every standard method that takes the scene is run.
    """

    name: str
    difficulty: str
    template: str
    small: tuple[float, ...]
    full: tuple[float, ...]
    options: tuple[str, ...] = ()

    def scenes(self, full: bool) -> dict[float, str]:
        """Return the keys of the scenes by difficulty."""
        return {v: self.template.format(v) for v in (self.full if full else self.small)}

    def methods(self, value: float) -> list[str] | None:
        """Return the methods of one difficulty, None: all that take the scene."""
        return [spec.format(value) for spec in self.options] or None


MAPS = (
    Map(
        "stiffness", "stiffness K", "stiff_contact[K={:g}]", (10, 1e3, 1e4), (1, 10, 100, 1e3, 1e4)
    ),
    Map("number", "rods N", "rods_wall[n={:d}]", (3, 10, 30), (3, 10, 30, 100)),
    Map("discs", "discs N", "discs[n={:d},seed=0]", (3, 10), (3, 10, 30, 100)),
    Map("angle", "angle in degrees", "corner[psi={:g}]", (1, 60, 179), (1, 3, 10, 60, 150, 179)),
    Map("height", "stack height n", "stack[n={:d}]", (3, 10, 30), (3, 10, 30, 100)),
    Map(
        "sweeps",
        "sweeps in a step",
        "stack[n=10]",
        (1, 4, 16),
        (1, 4, 16, 64),
        ("pbd[sweeps={:d}]", "pbd[order=reverse,sweeps={:d}]"),
    ),
)


@dataclass(frozen=True)
class Cell:
    """One run: method, its step or OWN, status, sentence, error (None where there is none).

    share: the error over the largest displacement of the true solution from its start, or a radius
    if that is larger.
    """

    method: str
    column: str
    h: float | None
    status: str
    sentence: str
    error: float | None
    share: float | None


def methods_of(case: Case, has_penalty: bool = True) -> list[str]:
    """List the standard methods that take the case."""
    out = []
    for spec in solvers.standard():
        name = spec.partition("[")[0]
        if name in UNLISTED or (name == "penalty" and not has_penalty):
            continue
        if not solvers.get(spec).refuses(case):
            out.append(spec)
    return out


def fill_row(key: str, methods: list[str] | None = None) -> list[dict]:
    """Run all methods on one scene with all steps; return its cells."""
    case = find_scene(key)
    context = context_of_truth(case)
    spacing = float(np.diff(case.t).min())
    cells = []
    for spec in methods_of(case) if methods is None else methods:
        accuracy = solvers.get(spec).accuracy
        if accuracy != "h":
            cells.append(_run(case, spec, {}, OWN, None, context))
            continue
        for n in DIVISORS:
            h = spacing / n
            cells.append(_run(case, spec, {"h": h}, f"/{n}", h, context))
    return [asdict(c) for c in cells]


def _run(
    case: Case, spec: str, accuracy: dict, column: str, h: float | None, context: MeasureContext
) -> Cell:
    traj = solvers.solve(case, spec, **accuracy)
    code = traj.status.code
    error = None
    share = None
    if code in USABLE and np.isfinite(traj.x).all():
        error = float(np.abs(traj.x - context.ref.x).max())
        moved = float(np.abs(context.ref.x - case.x0).max())
        share = error / max(moved, case.radius or 0.0, np.finfo(float).tiny)
    sentence = "" if code == "ok" else str(traj.status)
    return Cell(spec, column, h, code, sentence, error, share)
