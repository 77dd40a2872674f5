"""Which panels a case gets, from its rows; and the talk's figure."""
from __future__ import annotations

import numpy as np

from nsbench.report import panels, speed
from nsbench.report.panels import Line, Panel
from nsbench.report.source import Data, Runs
from nsbench.report.style import INK, MUTED, PALETTE, RULE, Look, clean, num
from nsbench.report.summary import Summary

ROUNDING = 1e-11     # a line that never rises above it shows rounding, not a method
STEP = "step h (or 1/k)"


def case_panels(runs: list[Runs], looks: dict[str, Look], summaries: dict[tuple, Summary]) -> list[Panel]:
    """The panels of one case that have something to show, in reading order."""
    mine = [summaries[r.case, r.solver] for r in runs]
    force = mine[0].force.metric if mine else "impulse"
    named = {"impulse": "Impulse error", "reaction": "Reaction error (multipliers are not unique)"}[force]
    out = [
        Panel("state", "State error", STEP, _against_h(runs, looks, "state_sup"), _floor(runs, "state_sup"),
              _claims(mine, "state")),
        Panel("multiplier", named, STEP, _against_h(runs, looks, force), _floor(runs, force), _claims(mine, "force")),
        Panel("seconds", "State error against seconds", "seconds of the run (open markers: host loop)",
              _against(runs, looks, lambda r: r.col["seconds"]), _floor(runs, "state_sup")),
        Panel("work", "State error against counted work", "drift calls + projections + inner iterations",
              _against(runs, looks, speed.work), _floor(runs, "state_sup")),
        Panel("violation", "Violation max(-g)", STEP, _against_h(runs, looks, "feasibility"), 0.0,
              (1.0,) if any(s.violation.kind == "fit" for s in mine) else ()),
    ]
    if force == "reaction":
        out.append(Panel("selection", "Selection: not an error", STEP, _against_h(runs, looks, "selection", False)))
    else:
        out.append(Panel("settled", "Multiplier away from events", STEP, _against_h(runs, looks, "settled"),
                         0.0, _claims(mine, "force")))
    return [p for p in out if any(line.y.size or line.level > 0 for line in p.lines)]


def _floor(runs: list[Runs], metric: str) -> float:
    return max((r.floor(metric) for r in runs), default=0.0)


def _claims(mine: list[Summary], which: str) -> tuple[float, ...]:
    """Distinct claimed orders, at most two: the guides of a panel."""
    fits = [o for o in (s.state if which == "state" else s.force for s in mine) if o.kind == "fit"]
    orders = {o.claim for o in fits}
    return tuple(sorted(float(p) for p in orders if p))[:2]


def _against_h(runs: list[Runs], looks: dict, metric: str, failures: bool = True) -> tuple[Line, ...]:
    """`metric` over the step taken; a method with a tolerance appears as the level of its best error."""
    out = []
    for r in runs:
        values, h = np.abs(r.col[metric]), r.col["h"]
        use = r.good & np.isfinite(values) & (h > 0)
        none = np.empty(0)
        if r.accuracy == "tol":
            if use.any():
                out.append(Line(r.solver, looks[r.solver], none, none, none, float(values[use].min())))
            continue
        refused = np.isin(r.col["status"], ("refused",))
        failed = np.unique(h[~r.good & ~refused & (h > 0)]) if failures else none
        if use.any() or failed.size:
            rounding = bool(use.any() and values[use].max() < ROUNDING)
            out.append(Line(r.solver, looks[r.solver], h[use], values[use], failed, far=rounding))
    return tuple(out)


def _against(runs: list[Runs], looks: dict, cost) -> tuple[Line, ...]:
    """State error over a cost; markers are open where the loop is not compiled."""
    out = []
    for r in runs:
        x, y = cost(r), np.abs(r.col["state_sup"])
        use = r.good & np.isfinite(x) & (x > 0) & np.isfinite(y)
        if use.any():
            out.append(Line(r.solver, looks[r.solver], x[use], y[use], np.empty(0), hollow=r.loop == "host",
                            far=r.accuracy == "tol"))
    return tuple(out)


def _curve(value) -> np.ndarray | None:
    """A plane curve as (k, 2) from a list of points or from two lists; None if it is neither."""
    try:
        a = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    if a.ndim != 2 or 2 not in a.shape:
        return None
    a = a if a.shape[1] == 2 else a.T
    return a[np.isfinite(a).all(axis=1)]


def talk_runs(talk) -> list[tuple[str, list]]:
    """("explicit" or "implicit", [(dt, curve), ...]) of the stored runs, at most four each."""
    rows: dict = {}
    for run in talk.get("runs") or ():
        if isinstance(run, dict):
            curve = _curve(run.get("x"))
            if curve is not None and len(curve):
                name = "implicit" if "implicit" in str(run.get("solver")) else "explicit"
                rows.setdefault(name, []).append((run.get("dt"), curve))
    return [(name, group[:4]) for name, group in rows.items()]


def talk_figure(data: Data) -> str:
    """Explicit Euler on the talk's sliding example beside the exact solution, implicit Euler below; "" without it.

    extra.json: ``{"talk_figure": {"runs": [{"solver", "dt", "x"}, ...], "exact": x}}``, x being points or two lists of
    coordinates.
    """
    from matplotlib.figure import Figure
    talk = data.extra.get("talk_figure")
    rows = talk_runs(talk) if isinstance(talk, dict) else []
    if not rows:
        return ""
    exact = _curve(talk.get("exact"))
    exact = exact if exact is not None and len(exact) else None
    across = max(len(group) for _, group in rows)
    fig = Figure(figsize=(2.4 * across + 0.4, 1.9 * len(rows) + 0.3))
    fig.patch.set_visible(False)
    every = [c for _, group in rows for _, c in group] + ([exact] if exact is not None else [])
    limits = [(min(c[:, k].min() for c in every), max(c[:, k].max() for c in every)) for k in (0, 1)]
    for i, (name, group) in enumerate(rows):
        for j, (dt, curve) in enumerate(group):
            ax = fig.add_subplot(len(rows), across, i * across + j + 1, facecolor="none")
            _talk_axes(ax, limits, f"{name} Euler, dt = {num(dt) if isinstance(dt, (int, float)) else clean(dt, 12)}")
            ax.plot(*curve.T, color=PALETTE[1] if name == "explicit" else PALETTE[0], lw=1.1, marker="o", ms=2.4)
            if exact is not None:
                ax.plot(*exact.T, color=INK, lw=0.9, ls="--")
    fig.subplots_adjust(0.07, 0.11, 0.99, 0.92, 0.2, 0.45)
    return panels._svg(fig, "talk")


def talk_sentence(data: Data) -> str:
    """How far each run strays from the exact path, in words; "" without the figure."""
    talk = data.extra.get("talk_figure")
    if not isinstance(talk, dict):
        return ""
    exact, parts = _curve(talk.get("exact")), []
    if exact is None or len(exact) < 2:
        return "Euler's method on the talk's sliding example, explicit and implicit."
    for name, group in talk_runs(talk):
        far = ", ".join(f"{num(strays(curve, exact))} (dt = {dt})" for dt, curve in group)
        parts.append(f"{name} Euler {far}")
    return f"Largest distance from the exact path (dashed): {'; '.join(parts)}."


def strays(curve: np.ndarray, path: np.ndarray) -> float:
    """Largest distance of the points `curve` (k, 2) from the polygon through `path` (m, 2)."""
    a, d = path[:-1], np.diff(path, axis=0)
    square = np.maximum((d * d).sum(axis=1), 1e-300)
    s = np.clip(((curve[:, None] - a) * d).sum(axis=2) / square, 0.0, 1.0)
    return float(np.linalg.norm(curve[:, None] - a - s[..., None] * d, axis=2).min(axis=1).max())


def _talk_axes(ax, limits, title: str):
    (x0, x1), (y0, y1) = limits
    ax.set_xlim(x0 - 0.04 * (x1 - x0 or 1), x1 + 0.04 * (x1 - x0 or 1))
    ax.set_ylim(y0 - 0.12 * (y1 - y0 or 1), y1 + 0.12 * (y1 - y0 or 1))
    if y0 <= 0 <= y1:
        ax.axhline(0.0, color=RULE, lw=0.8)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set(color=MUTED, linewidth=0.7)
    ax.tick_params(color=MUTED, labelcolor=MUTED, labelsize=7, width=0.6, length=2.5)
    ax.set_title(title, size=8.5, color=INK, loc="left", pad=4)
