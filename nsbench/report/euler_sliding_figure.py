"""Draw explicit and implicit Euler beside the exact solution of the `sliding` example.

The runs are stored in extra.json. The figure is drawn with matplotlib's Figure (no pyplot).
"""

from __future__ import annotations

import io
import re

import numpy as np

from nsbench.report.data import Data
from nsbench.report.style import INK, MUTED, PALETTE, RULE, format_number, sanitise

MAX_RUNS = 4  # of one method: more would be too small to read


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


def select_runs(talk: dict) -> list[tuple[str, list]]:
    """Group the stored runs: ("explicit" or "implicit", [(dt, curve), ...]), at most four each."""
    rows: dict = {}
    for run in talk.get("runs") or ():
        if isinstance(run, dict):
            curve = _curve(run.get("x"))
            if curve is not None and len(curve):
                name = "implicit" if "implicit" in str(run.get("solver")) else "explicit"
                rows.setdefault(name, []).append((run.get("dt"), curve))
    return [(name, group[:MAX_RUNS]) for name, group in rows.items()]


def draw_euler_sliding_figure(data: Data) -> str:
    """Draw explicit Euler beside the exact solution, implicit Euler below; "" without stored runs.

    extra.json: ``{"talk_figure": {"runs": [{"solver", "dt", "x"}, ...], "exact": x}}``, x being
    points or two lists of coordinates.
    """
    from matplotlib.figure import Figure

    talk = data.extra.get("talk_figure")
    rows = select_runs(talk) if isinstance(talk, dict) else []
    if not rows:
        return ""
    exact = _curve(talk.get("exact"))
    exact = exact if exact is not None and len(exact) else None
    columns = max(len(group) for _, group in rows)
    fig = Figure(figsize=(2.4 * columns + 0.4, 1.9 * len(rows) + 0.3))
    fig.patch.set_visible(False)
    curves = [c for _, group in rows for _, c in group] + ([exact] if exact is not None else [])
    limits = [
        (min(c[:, k].min() for c in curves), max(c[:, k].max() for c in curves)) for k in (0, 1)
    ]
    for i, (name, group) in enumerate(rows):
        for j, (dt, curve) in enumerate(group):
            ax = fig.add_subplot(len(rows), columns, i * columns + j + 1, facecolor="none")
            _talk_axes(
                ax,
                limits,
                f"{name} Euler, dt = "
                f"{format_number(dt) if isinstance(dt, (int, float)) else sanitise(dt, 12)}",
            )
            ax.plot(
                *curve.T,
                color=PALETTE[1] if name == "explicit" else PALETTE[0],
                lw=1.1,
                marker="o",
                ms=2.4,
            )
            if exact is not None:
                ax.plot(*exact.T, color=INK, lw=0.9, ls="--")
    fig.subplots_adjust(0.07, 0.11, 0.99, 0.92, 0.2, 0.45)
    return _svg(fig, "talk")


def describe_euler_sliding_figure(data: Data) -> str:
    """Report the largest distance of each run from the exact path; "" without the figure."""
    talk = data.extra.get("talk_figure")
    if not isinstance(talk, dict):
        return ""
    exact = _curve(talk.get("exact"))
    parts = []
    if exact is None or len(exact) < 2:
        return "Euler's method on the talk's sliding example, explicit and implicit."
    for name, group in select_runs(talk):
        distances = ", ".join(
            f"{format_number(largest_distance(curve, exact))} (dt = {dt})" for dt, curve in group
        )
        parts.append(f"{name} Euler {distances}")
    return (
        "Two fields point at one surface, and the solution slides along it: explicit Euler crosses "
        "the surface to and fro, in proportion to its step, implicit Euler stays on it. Largest "
        f"distance from the exact path (dashed): {'; '.join(parts)}."
    )


def largest_distance(curve: np.ndarray, path: np.ndarray) -> float:
    """Compute the largest distance of points `curve` (k, 2) from the polygon `path` (m, 2)."""
    a = path[:-1]
    d = np.diff(path, axis=0)
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


def _svg(fig, salt: str) -> str:
    """The figure as SVG text without date, version, fonts and needless digits; reproducible."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    settings = {
        "svg.hashsalt": salt,
        "svg.fonttype": "none",
        "font.family": "DejaVu Sans",
        "text.usetex": False,
    }
    with rc_context(settings), io.StringIO() as out:
        FigureCanvasSVG(fig).print_svg(
            out, metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
        )
        text = out.getvalue()
    text = text[text.index("<svg") :].strip()
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, flags=re.S)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.S)
    text = re.sub(r"(\d\.\d{2})\d+", r"\1", text)  # a hundredth of a point is not visible
    text = re.sub(r'font: ([\d.]+)px [^;"]*', r"font: \1px system-ui, sans-serif", text)
    text = re.sub(r' (width|height)="[\d.]+pt"', "", text, count=2)
    return re.sub(r"\s*\n\s*", "\n", text).replace(' version="1.1"', "")
