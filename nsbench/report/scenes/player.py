"""Frames of moving scenes: runs of one case beside each other and beside the reference, as JSON.

A player holds at most MAX_FRAMES samples of each run. Coordinates are whole multiples of `unit`,
stored by coordinate as differences from frame to frame (they compress to about a byte a number):

    kind         particles, plane or curves: how a state is drawn
    t            times of the frames
    unit, box    length of one in `states`; x0, x1, y0, y1 around all that is drawn
    groups       of particles: start, dim, count, radius (a number, one for each, or none)
    walls        half-planes a x + b y + c >= 0
    links        pairs [group, i, j]; fixed [group, i, x, y] to an anchor
    region, lines, arrows   of a plane: forbidden polygons, switching surfaces, directions
    reference    its states, or null
    runs         solver, accuracy, asked, status, why; states, error and violation by frame;
                 contacts with their multipliers `lam` by frame, in multiples of lam_unit

The multiplier of a frame is the mean since the frame before: the difference of the impulses over
the time between.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from nsbench.case import Case
from nsbench.problem import Affine, Complementarity, Distance, Filippov
from nsbench.report.scenes.figure import Frame
from nsbench.report.scenes.particles import (
    anchor_points,
    drawing_extent,
    find_walls,
    particle_groups,
)
from nsbench.report.scenes.surroundings import draw_surroundings
from nsbench.report.style import sanitise
from nsbench.trajectory import Trajectory

MAX_FRAMES = 61
MAX_STATE = 400  # entries of a state: a player of more would be a file of megabytes
MAX_CONTACTS = 120  # of a run, those with the largest impulses
UNITS = 8000  # across what is drawn: far below a pixel, and below the overlaps that are shown
LAM_UNITS = 200
MAX_PLACE = 1e9  # of a coordinate, in units: a state beyond it has diverged
# methods that are shown where a study has them, in this order; then the others of the study
PREFERRED = ("pbd", "catching_up", "euler", "euler[implicit=true]", "theta", "theta[theta=0.5]")
FINE = 4.0  # the second step of a method is this many times smaller, as near as the study has it
MAX_STEPS = 20_000  # of a run that is made again for its frames: a second at most


def choose_runs(case: Case, asked: Mapping[str, Sequence[float]]) -> list[tuple[str, float]]:
    """Choose two methods and two accuracies of each: [(solver, accuracy)].

    asked: accuracies of the study by method, so that the seconds of these runs are known. Taken are
    the coarsest, where errors can be seen, and one FINE times smaller; runs of more than MAX_STEPS
    steps are not made again for a picture.
    """
    span = float(case.t[-1] - case.t[0])
    order = [s for s in PREFERRED if s in asked] + [s for s in asked if s not in PREFERRED]
    out: dict[str, list[float]] = {}
    for solver in order:
        name = _accuracy_of(case, solver)
        values = [v for v in asked[solver] if v > 0 and (name != "h" or span / v <= MAX_STEPS)]
        if name and values and len(out) < 2:
            finer = FINE if name == "k" else 1 / FINE
            coarse = min(values) if name == "k" else max(values)
            others = [v for v in values if v != coarse] or [coarse]
            near = min(others, key=lambda v: abs(math.log(v / (coarse * finer))))
            out[solver] = list(dict.fromkeys((coarse, near)))
    return [(solver, value) for solver, values in out.items() for value in values]


def _accuracy_of(case: Case, solver: str) -> str:
    """Name of the accuracy parameter of a method; "" if it does not take the case.

    A method of a user's file is not known in every process.
    """
    from nsbench.solvers import get

    try:
        method = get(solver)
    except LookupError:
        return ""
    return "" if method.refuses(case) else method.accuracy


def build_player(
    case: Case, reference: np.ndarray | None, runs: Iterable[tuple[str, float]]
) -> dict | None:
    """Run the case and collect its frames; None for a state of more than MAX_STATE entries.

    reference: states (len(case.t), n) or None. runs: (solver, accuracy) each.
    """
    from nsbench.solvers import get, solve

    if case.n > MAX_STATE:
        return None
    done = [
        (solver, value, solve(case, solver, **{get(solver).accuracy: value}))
        for solver, value in runs
    ]
    return collect_frames(case, reference, done)


def collect_frames(
    case: Case, reference: np.ndarray | None, done: list[tuple[str, float, Trajectory]]
) -> dict | None:
    """Collect the frames of runs that were made; None as in `build_player`, or without a state."""
    from nsbench.solvers import get

    count = min(len(case.t), MAX_FRAMES)
    at = np.unique(np.linspace(0, len(case.t) - 1, count).round().astype(int))
    known = [x for x in (reference, *(t.x for _, _, t in done)) if x is not None and len(x)]
    shown = [x[: _count_finite(x)] for x in known if _count_finite(x)]
    if not shown or case.n > MAX_STATE:
        return None
    kind = player_kind(case)
    box = _box(case, kind, shown[0])
    size = max(box[1] - box[0], box[3] - box[2]) if box else float(np.ptp(shown[0])) or 1.0
    unit = float(f"{size / UNITS:.2g}")
    lam = [_multipliers(case, trajectory, at) for _, _, trajectory in done]
    largest = max((float(np.max(v)) for _, v in lam if v.size), default=0.0)
    lam_unit = float(f"{max(largest, 1e-300) / LAM_UNITS:.3g}")
    runs = [
        {
            "solver": sanitise(solver, 80),
            "accuracy": get(solver).accuracy,
            "asked": value,
            "status": trajectory.status.code,
            "why": sanitise(str(trajectory.status), 200) if not trajectory.status.ok else "",
            **_frames(case, reference, trajectory, at, unit),
            "contacts": [_describe_contact(case, c) for c in contacts],
            "lam": [_differences(np.round(column / lam_unit)) for column in values.T],
        }
        for (solver, value, trajectory), (contacts, values) in zip(done, lam, strict=True)
    ]
    ghost = None if reference is None else _encode(reference[at], unit)
    out = {"kind": kind, "t": [_short(t) for t in case.t[at]], "unit": unit, "lam_unit": lam_unit}
    out |= {"n": case.n, "reference": ghost, "runs": runs}
    if box:
        out["box"] = [_short(v) for v in box]
    if kind == "particles":
        out |= _particles(case)
    if kind == "plane":
        out |= draw_surroundings(case, box)
    return out


def player_kind(case: Case) -> str:
    """Return how a state is drawn: particles, plane or curves."""
    p = case.problem
    if isinstance(p, Complementarity):
        flat = [c for c in p.constraints if isinstance(c, Distance) and c.dim > 1]
        if flat and case.n > flat[0].dim:
            return "particles"
        still = not any(getattr(c, "moving", False) for c in p.constraints)
        rods = any(isinstance(c, Distance) and c.dim == 1 for c in p.constraints)
        return "plane" if case.n == 2 and p.constraints and still and not rods else "curves"
    return "plane" if isinstance(p, Filippov) and case.n == 2 else "curves"


def _count_finite(x: np.ndarray) -> int:
    """Count the states (k, n) before the first that is not finite."""
    good = np.all(np.isfinite(x), axis=1)
    return len(x) if good.all() else int(np.argmin(good))


def _box(case: Case, kind: str, x: np.ndarray) -> list[float] | None:
    """x0, x1, y0, y1 with a margin around the path x (k, n); None for curves over time."""
    if kind == "curves":
        return None
    frames = [
        Frame(float(case.t[0]), state, case.t[: len(x)], x)
        for state in x[:: max(1, len(x) // 20)]
    ]
    low, high = drawing_extent(case, frames, kind)
    if not np.all(np.isfinite([*low, *high])):
        low = np.zeros(2)
        high = np.ones(2)
    pad = 0.06 * float(np.max(high - low)) or 1.0
    if kind == "plane":  # a path along a line has surroundings too
        pad = 0.1 * float(np.max(high - low)) or 1.0
        middle = (low + high) / 2
        half = np.maximum((high - low) / 2, 0.3 * float(np.max(high - low)))
        low = middle - half
        high = middle + half
    return [low[0] - pad, high[0] + pad, low[1] - pad, high[1] + pad]


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def _differences(values: np.ndarray) -> list[int]:
    """Whole numbers (k,) as the first one and the differences from one to the next."""
    whole = values.astype(np.int64)
    return [int(whole[0]), *np.diff(whole).tolist()] if whole.size else []


def _encode(x: np.ndarray, unit: float) -> list[list[int]]:
    """States (k, n) by coordinate in multiples of `unit`, up to the first that left all bounds."""
    with np.errstate(over="ignore"):
        places = np.round(x / unit)
    places = np.where(np.abs(places) < MAX_PLACE, places, np.nan)
    return [_differences(column) for column in places[: _count_finite(places)].T]


def _frames(case: Case, reference, trajectory: Trajectory, at: np.ndarray, unit: float) -> dict:
    """States, error and violation of a run by frame."""
    if not len(trajectory.x):
        return {"states": [], "error": [], "violation": []}
    x = np.asarray(trajectory.x)[at[at < len(trajectory.x)]]
    with np.errstate(invalid="ignore"):
        error = [] if reference is None else np.abs(x - reference[at[: len(x)]]).max(axis=1)
    number = lambda v: float(f"{v:.2e}") if math.isfinite(v) else None
    return {
        "states": _encode(x, unit),
        "error": [number(v) for v in error],
        "violation": [number(v) for v in _violations(case, case.t[at], x)],
    }


def _violations(case: Case, t: np.ndarray, x: np.ndarray) -> list[float]:
    """max(-g, 0) of each state; [] without constraints."""
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    if not getattr(case.problem, "constraints", ()):
        return []
    scene = ConstraintSet(case.problem, case.n)
    finite = [np.all(np.isfinite(state)) for state in x]
    return [
        scene.max_violation(float(s), state) if known else math.nan
        for s, state, known in zip(t, x, finite, strict=False)
    ]


def _multipliers(case: Case, trajectory: Trajectory, at: np.ndarray) -> tuple[list, np.ndarray]:
    """The contacts with the largest impulses, and their mean multipliers by frame (k, m)."""
    impulse = np.asarray(trajectory.impulse)
    if not impulse.size or not len(trajectory.x):
        return [], np.empty((0, 0))
    at = at[at < _count_finite(impulse)]
    if len(at) < 2:
        return [], np.empty((0, 0))
    rates = np.diff(impulse[at], axis=0) / np.diff(case.t[at])[:, None]
    values = np.vstack((rates[:1], rates))
    total = np.abs(values).sum(axis=0)
    kept = np.sort(np.argsort(-total, kind="stable")[:MAX_CONTACTS])
    kept = kept[total[kept] > 0]
    return [trajectory.contacts[k] for k in kept], np.maximum(values[:, kept], 0.0)


def _particles(case: Case) -> dict:
    """Groups, walls, links and anchors of a case with particles."""
    groups = particle_groups(case)
    t = float(case.t[0])
    radius = lambda r: None if r is None else [_short(v) for v in np.atleast_1d(r)]
    out = {
        "groups": [
            {"start": start, "dim": dim, "count": count, "radius": radius(r)}
            for (start, dim, count), r in groups.items()
        ],
        "walls": [],
        "links": [],
        "fixed": [],
    }
    for k, (key, r) in enumerate(groups.items()):
        walls = find_walls(case, key, r, t)
        out["walls"] += [[_short(v) for v in wall] for wall in walls]
        for c in case.problem.constraints:
            if not isinstance(c, Distance) or c.all_pairs or _group_of(case, c) != key:
                continue
            if c.anchors is None:
                out["links"] += [[k, int(i), int(j)] for i, j in c.pairs]
            elif c.sign < 0 and c.pairs is not None:
                points = anchor_points(c, t)
                out["fixed"] += [
                    [k, int(i), *(_short(v) for v in points[j, :2])] for i, j in c.pairs
                ]
    return out


def _group_of(case: Case, c: Distance) -> tuple[int, int, int]:
    return c.start, c.dim, c.particles(case.n)


def _describe_contact(case: Case, contact: tuple) -> dict:
    """Where a contact acts: pair (g, i, j), wall (g, i, normal x, y), or its name alone."""
    out: dict = {"name": ":".join(map(str, contact))}
    constraints = getattr(case.problem, "constraints", ())
    family = constraints[contact[0]] if contact[0] < len(constraints) else None
    if isinstance(family, Distance) and family.dim > 1:
        g = list(particle_groups(case)).index(_group_of(case, family))
        pair = contact[1:] if len(contact) == 3 or family.pairs is None else None
        i, j = pair if pair is not None and len(pair) == 2 else family.pairs[contact[1]]
        if family.anchors is None:
            return out | {"g": g, "i": int(i), "j": int(j)}
        point = anchor_points(family, float(case.t[0]))[int(j), :2]
        return out | {"g": g, "i": int(i), "to": [_short(v) for v in point]}
    if isinstance(family, Affine):
        return out | _wall_contact(case, family, int(contact[1]))
    return out


def _wall_contact(case: Case, family: Affine, row: int) -> dict:
    """The particle that an affine row moves and the direction from it to the wall, if it is one."""
    entries = slice(family.indptr[row], family.indptr[row + 1])
    columns = family.indices[entries]
    values = family.data[entries]
    if player_kind(case) != "particles":
        return {}
    for g, (start, dim, count) in enumerate(particle_groups(case)):
        owner = (columns - start) // dim
        if len(owner) and np.all(owner == owner[0]) and 0 <= owner[0] < count:
            normal = np.zeros(dim)
            normal[(columns - start) % dim] = values
            size = float(np.linalg.norm(normal)) or 1.0
            return {"g": g, "i": int(owner[0]), "n": [_short(v) for v in -normal[:2] / size]}
    return {}
