"""How many steps the multipliers of a method need until they are right, after an event or a start.

Every step is a sample, and the multiplier of step n is the increment of the impulse over h; the
true one is that of the closed form. A contact has settled at the step from which on it is right to
TOLERANCE of the largest true multiplier until the next event, or the end. In a pile multipliers are
not unique; there reactions are compared, and the sum of the loads on the floor.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case, get_case
from nsbench.measure.orders.slopes import fit_slope
from nsbench.reference import canonical, listed_contacts
from nsbench.studies.multipliers.warm_start import run_variant
from nsbench.studies.runs.finished_run import WELL
from nsbench.trajectory import Trajectory

TOLERANCE = 0.01
SQUARES = 6  # steps over n^2 for which a column is followed
COLUMN_STEP = 1e-5  # of a column or pile: overlaps stay far below the radius
PILE_WIDTH = 4  # discs on the floor of a pile


def step_multipliers(
    case: Case, method: str, h: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the multipliers of all steps, of the method and true: (steps, m) each.

    Columns are those of the closed form. Raises ArithmeticError where the run does not end well.
    """
    t = float(case.t[0]) + h * np.arange(steps + 1)
    traj = _finish(case.replace(t=t), method, h)
    ids = tuple(case.contacts) if case.contacts is not None else listed_contacts(case)
    place = {canonical(case.problem, c): k for k, c in enumerate(ids)}
    impulse = np.zeros((steps + 1, len(ids)))
    for column, contact in zip(traj.impulse.T, traj.contacts, strict=True):
        impulse[:, place[canonical(case.problem, contact)]] += column
    return np.diff(impulse, axis=0) / h, np.diff(case.exact_impulse(t), axis=0) / h


def _finish(case: Case, method: str, h: float) -> Trajectory:
    """Run a method or a variant of PBD. Raises ArithmeticError where it does not end well."""
    traj = run_variant(case, method, h)
    if traj.status.code not in WELL:
        raise ArithmeticError(f"{method} on {case.key}: {traj.status}")
    return traj


def settled_from(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return for each contact the number of steps after which it stays right, (m,).

    The number of all steps stands for a contact that is not right in the last one.
    """
    wrong = np.abs(found - true) > TOLERANCE * np.abs(true).max()
    steps = len(wrong)
    last = steps - np.argmax(wrong[::-1], axis=0)
    return np.where(wrong.any(axis=0), last, 0)


def arrives_at(load: np.ndarray, true: float) -> int | None:
    """Return the number of steps after which a load (steps,) first reaches the true one.

    It is reached when no more than TOLERANCE of it is missing; None: never.
    """
    reached = load >= (1.0 - TOLERANCE) * true
    return int(np.argmax(reached)) if reached.any() else None


def follow_column(n: int, method: str) -> dict:
    """Count steps until the multiplier of each contact of a column of n discs at rest is right.

    Contacts by their distance from the top, where the load 1 is known: steps[d - 1] belongs to the
    contact that carries d discs, the last one to the floor. None: not within SQUARES n^2 steps.
    arrived: steps until the load on the floor first reaches its own; peak: its largest, over it.
    """
    steps = SQUARES * n * n
    found, true = step_multipliers(get_case("stack", n=n), method, COLUMN_STEP, steps)
    # a contact is right when it is right to a hundredth of its own load
    scale = true.max(axis=0)
    counts = settled_from(found / scale, true / scale)[::-1]
    return {
        "n": n,
        "method": method,
        "steps": _within(counts, steps),
        "arrived": arrives_at(found[:, 0], scale[0]),
        "peak": float(found[:, 0].max() / scale[0]),
    }


def _within(counts: np.ndarray, steps: int) -> list[int | None]:
    """Replace the number of all steps, of what is not right at the end, by None."""
    return [int(c) if c < steps else None for c in counts]


def follow_pile(rows: int, method: str) -> dict:
    """Count steps until the reaction on the discs of each row of a pile at rest is right.

    The pile is hexagonal, PILE_WIDTH and one less discs in a row between two walls; the reaction
    on a disc is its weight 1, to TOLERANCE in each coordinate. steps: by row, from the top; None:
    not within SQUARES rows^2 steps. arrived: steps until the floor first carries all discs.
    """
    case = get_case("stack", n=rows, columns=PILE_WIDTH, shape="hex")
    steps = SQUARES * rows**2
    traj = _finish(case.replace(t=COLUMN_STEP * np.arange(steps + 1)), method, COLUMN_STEP)
    heights, row = np.unique(np.round(case.x0[1::2], 9), return_inverse=True)
    weights = np.tile([0.0, 1.0], len(row))
    found = np.diff(traj.reaction, axis=0) / COLUMN_STEP
    counts = settled_from(found, np.tile(weights, (steps, 1))).reshape(-1, 2).max(axis=1)
    by_row = [counts[row == k].max() for k in reversed(range(len(heights)))]
    floor = [c[0] == 0 and c[1] < len(row) for c in traj.contacts]  # the rows of y_i >= 1
    load = np.diff(traj.impulse[:, floor].sum(axis=1)) / COLUMN_STEP
    return {
        "n": rows,
        "discs": len(row),
        "method": method,
        "steps": _within(np.array(by_row), steps),
        "arrived": arrives_at(load, float(len(row))),
        "peak": float(load.max() / len(row)),
    }


def fit_growth(columns: list[dict]) -> dict:
    """Fit steps ~ a n^p to the steps until all is right, with the 95 % interval of p.

    Of a column that is its floor.
    """
    known = [(c["n"], last) for c in columns if (last := last_right(c))]
    power, (low, high), factor = fit_slope(*np.array(known, float).T.reshape(2, -1))
    found = {"power": power, "low": low, "high": high, "factor": factor}
    found["over_square"] = [s / n**2 for n, s in known]
    return {k: _json(v) for k, v in found.items()}


def last_right(found: dict) -> int | None:
    """Return the steps until the floor of a column, or every row of a pile, is right."""
    if "discs" not in found:
        return found["steps"][-1]
    return None if None in found["steps"] else max(found["steps"])


def _json(value: object) -> object:
    """Replace a number that JSON cannot hold by None."""
    if isinstance(value, list):
        return [_json(v) for v in value]
    return float(value) if np.isfinite(value) else None


def follow_events(key: str, method: str, divisor: int) -> list[dict]:
    """Count steps from each event of a case until all multipliers are right.

    divisor: steps in the shortest sample interval. steps None: not before the next event.
    """
    case = get_case(key)
    h = float(np.diff(case.t).min()) / divisor
    total = int(round((case.t[-1] - case.t[0]) / h))
    found, true = step_multipliers(case, method, h, total)
    times = sorted(float(e) for e in case.exact_events)
    bounds = [min(total, int(np.ceil((e - case.t[0]) / h - 1e-9))) for e in times]
    out = []
    for event, first, end in zip(times, bounds, [*bounds[1:], total], strict=True):
        if end - 1 <= first or not np.abs(true[first : end - 1]).max() > 0.0:
            continue
        # the step that holds the next event belongs to neither side
        last = end - 1 if end < total else end
        steps = int(settled_from(found[first:last], true[first:last]).max())
        out.append(
            {
                "case": key,
                "method": method,
                "h": h,
                "event": event,
                "available": last - first,
                "steps": steps if steps < last - first else None,
            }
        )
    return out

