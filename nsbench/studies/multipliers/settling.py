"""How many steps the multipliers of a method need until they are right, after an event or a start.

Every step is a sample, and the multiplier of step n is the increment of the impulse over h; the
true one is that of the closed form. A contact has settled at the step from which on it is right to
TOLERANCE of the largest true multiplier until the next event, or the end.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case, get_case
from nsbench.measure.orders.slopes import fit_slope
from nsbench.reference import canonical, listed_contacts
from nsbench.studies.runs.finished_run import finish

TOLERANCE = 0.01
SQUARES = 6  # steps over n^2 for which a column is followed
COLUMN_STEP = 1e-5  # of a column: overlaps stay far below the radius


def step_multipliers(
    case: Case, method: str, h: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the multipliers of all steps, of the method and true: (steps, m) each.

    Columns are those of the closed form. Raises ArithmeticError where the run does not end well.
    """
    t = float(case.t[0]) + h * np.arange(steps + 1)
    traj = finish(case.replace(t=t), method, h)
    ids = tuple(case.contacts) if case.contacts is not None else listed_contacts(case)
    place = {canonical(case.problem, c): k for k, c in enumerate(ids)}
    impulse = np.zeros((steps + 1, len(ids)))
    for column, contact in zip(traj.impulse.T, traj.contacts, strict=True):
        impulse[:, place[canonical(case.problem, contact)]] += column
    return np.diff(impulse, axis=0) / h, np.diff(case.exact_impulse(t), axis=0) / h


def settled_from(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return for each contact the number of steps after which it stays right, (m,).

    The number of all steps stands for a contact that is not right in the last one.
    """
    wrong = np.abs(found - true) > TOLERANCE * np.abs(true).max()
    steps = len(wrong)
    last = steps - np.argmax(wrong[::-1], axis=0)
    return np.where(wrong.any(axis=0), last, 0)


def follow_column(n: int, method: str) -> dict:
    """Count steps until the multiplier of each contact of a column of n discs at rest is right.

    Contacts by their distance from the top, where the load 1 is known: steps[d - 1] belongs to the
    contact that carries d discs, the last one to the floor. None: not within SQUARES n^2 steps.
    """
    steps = SQUARES * n * n
    found, true = step_multipliers(get_case("stack", n=n), method, COLUMN_STEP, steps)
    # a contact is right when it is right to a hundredth of its own load
    scale = true.max(axis=0)
    counts = settled_from(found / scale, true / scale)[::-1]
    return {
        "n": n,
        "method": method,
        "steps": [int(c) if c < steps else None for c in counts],
    }


def fit_growth(columns: list[dict]) -> dict:
    """Fit steps ~ a n^p to the steps until the floor is right, with the 95 % interval of p."""
    known = [(c["n"], c["steps"][-1]) for c in columns if c["steps"][-1]]
    power, (low, high), factor = fit_slope(*np.array(known, float).T.reshape(2, -1))
    found = {"power": power, "low": low, "high": high, "factor": factor}
    found["over_square"] = [s / n**2 for n, s in known]
    return {k: _json(v) for k, v in found.items()}


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

