"""Draw a case or a trajectory as SVG text: the same input gives the same bytes.

The kind of drawing follows from the problem: particles with their links and walls; a point in the
plane before its constraints or its switching surface; anything else as curves over time. A case
file with ``draw(ax, case, x)`` draws one state itself (it updates the data limits of `ax`; a figure
of equal scale is fitted around them).
"""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case, case_module, load_module
from nsbench.problem import Affine, Complementarity, Distance, Filippov
from nsbench.report.style import INK, sanitise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# widths in inches: 280 px in the page; three panels on 840 px
SINGLE_WIDTH = 3.2
PANEL_WIDTH = 2.7
# strip above in inches: for a title, for the name of an axis alone, for nothing
TITLE_STRIP = 0.24
LABEL_STRIP = 0.17
NO_STRIP = 0.0
SCENE_MARGIN = 0.06  # inches on each side of a drawing without axes
AXES_MARGINS = (0.44, 0.36, 0.2)  # inches for labels at the left, the bottom and the right
# height over width of a panel is between these, in the plane at most MAX_PLANE_RATIO
MIN_RATIO = 0.4
MAX_RATIO = 1.3
MAX_PLANE_RATIO = 1.0
CURVES_RATIO = 0.62
PATH_POINTS = 400  # of an exact path
EXACT_TOLERANCE = 1e-6  # a path this close to the exact solution is drawn as that one
STYLE = {
    "svg.hashsalt": "nsbench",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 8.0,
    "text.usetex": False,
    "text.parse_math": False,
    "axes.unicode_minus": True,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#77736c",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": "#77736c",
    "ytick.color": "#77736c",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "path.simplify": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


@dataclass(frozen=True)
class Frame:
    """The content of one panel: a state x (n,) at time t with its label.

    times (k,), path (k, n): the path to it.
    """

    t: float
    x: np.ndarray
    times: np.ndarray
    path: np.ndarray
    label: str = ""


def scene_svg(
    case: Case, x: np.ndarray | None = None, title: str = "", t: float | None = None
) -> str:
    """Draw the state x (n,), by default the start, at time t, as SVG text.

    x may be a whole path (len(case.t), n). Raises ValueError for another shape.
    """
    return write_svg(scene_figure(case, x, title, t))


def frames_svg(case: Case, traj, times=None) -> str:
    """Draw a trajectory as SVG text.

    Small multiples at `times` (default: start, middle, end), or one picture of its path where the
    surroundings do not move. Samples that a failed run lacks are left out and reported as missing.
    """
    return write_svg(frames_figure(case, traj, times))


def scene_figure(case: Case, x=None, title: str = "", t: float | None = None):
    """Draw the matplotlib Figure behind `scene_svg`."""
    x = case.x0 if x is None else np.asarray(x, dtype=float)
    if x.shape[-1:] != (case.n,) or x.ndim > 2 or (x.ndim == 2 and len(x) != len(case.t)):
        raise ValueError(
            f"x has shape {x.shape}; ({case.n},) or ({len(case.t)}, {case.n}) is needed for "
            f"{case.name}"
        )
    t = float(case.t[0] if t is None else t)
    if x.ndim == 2:
        return frames_figure(case, Samples(case.t, x), case.t[[-1]], title)
    times = np.array([t])
    path = x[None]
    if (
        not _needs_frames(case)
        and case.exact is not None
        and t == case.t[0]
        and np.array_equal(x, case.x0)
    ):
        times, path = _refine_path(case, case.t, None)  # a dot alone would say nothing
    return _figure(case, [Frame(t, x, times, path, title)], SINGLE_WIDTH)


def _refine_path(case, t, x):
    """Return the path as times and states.

    Fine and with its kinks where x follows the exact solution (or is None); else x at t.
    """
    if case.exact is None or (
        x is not None and not np.allclose(case.exact(t), x, rtol=0.0, atol=EXACT_TOLERANCE)
    ):
        return t, x
    kinks = [e for e in (case.exact_events or ()) if t[0] < e < t[-1]]
    times = np.union1d(np.linspace(t[0], t[-1], PATH_POINTS), kinks) if len(t) > 1 else t
    return times, np.asarray(case.exact(times))


@dataclass(frozen=True)
class Samples:
    """Times (k,) and states (k, n): the part of a Trajectory that pictures need."""

    t: np.ndarray
    x: np.ndarray


def frames_figure(case: Case, traj, times=None, title: str = ""):
    """Draw the matplotlib Figure behind `frames_svg`."""
    t = np.asarray(traj.t)
    x = np.asarray(traj.x)
    if len(t) == 0:
        return scene_figure(case, None, title or "no run")
    times = (
        t[[0, len(t) // 2, -1]] if times is None else np.atleast_1d(np.asarray(times, dtype=float))
    )
    index = [int(np.abs(t - s).argmin()) for s in times]
    if _needs_frames(case):
        frames = [
            Frame(
                float(t[i]),
                x[i],
                *_refine_path(case, t[: i + 1], x[: i + 1]),
                title or f"t = {t[i]:.3g}",
            )
            for i in index
        ]
    else:
        frames = [Frame(float(t[0]), x[0], *_refine_path(case, t, x), title)]
    return _figure(case, frames, PANEL_WIDTH if len(frames) > 1 else SINGLE_WIDTH)


def _needs_frames(case: Case) -> bool:
    """Do surroundings or shape change in time, so that one picture of the path is not enough?"""
    kind = drawing_kind(case)
    if kind == "plane" and isinstance(case.problem, Complementarity):
        return any(c.moving for c in case.problem.constraints if isinstance(c, (Affine, Distance)))
    return kind in ("particles", "own")


def drawing_kind(case: Case) -> str:
    """Return how the case is drawn: own, particles, plane or curves."""
    p = case.problem
    if find_own_drawing(case.name, case.source):
        return "own"
    if isinstance(p, Complementarity):
        flat = [c for c in p.constraints if isinstance(c, Distance) and c.dim > 1]
        if flat and case.n > flat[0].dim:
            return "particles"
        return "plane" if case.n == 2 and p.constraints and not _rods(p) else "curves"
    return "plane" if isinstance(p, Filippov) and case.n == 2 else "curves"


def _rods(p) -> bool:
    """Does the problem have particles on a line?"""
    return any(isinstance(c, Distance) and c.dim == 1 for c in p.constraints)


@cache
def find_own_drawing(name: str, source: str):
    """Return the ``draw`` of the case's file `source`, or None.

    It is never that of another case of the same name.
    """
    if not source or not Path(source).is_file():
        return None
    try:
        module = case_module(name)
    except (LookupError, ValueError):
        module = None
    if getattr(module, "__file__", None) != source:
        module = load_module(source)
    return getattr(module, "draw", None)


def film_panel(case: Case, frame: Frame, film: list[Frame]) -> Figure:
    """Draw one frame of a film: all have the limits that hold the whole film."""
    return _figure(case, [frame], SINGLE_WIDTH, film)


def _figure(case, frames, width, within=()):
    """A Figure with one panel per frame side by side, all with the same scale.

    within: frames that the limits hold too.
    """
    import matplotlib
    from matplotlib.figure import Figure

    kind = drawing_kind(case)
    left, bottom, right = (
        (SCENE_MARGIN, SCENE_MARGIN, SCENE_MARGIN) if kind in ("own", "particles") else AXES_MARGINS
    )
    top = (
        TITLE_STRIP
        if any(f.label for f in frames)
        else NO_STRIP
        if kind in ("own", "particles")
        else LABEL_STRIP
    )
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        # glyphs that no font has here; the reader's fonts draw them
        warnings.simplefilter("ignore")
        box = _limits(case, [*frames, *within], kind)
        inner = width - left - right
        ratio = (box[3] - box[2]) / (box[1] - box[0])
        ratio = (
            CURVES_RATIO
            if kind == "curves"
            else float(np.clip(ratio, MIN_RATIO, MAX_PLANE_RATIO if kind == "plane" else MAX_RATIO))
        )
        if kind != "curves":
            box = equalise_scales(box, ratio)
        height = inner * ratio
        figure = Figure(figsize=(width * len(frames), bottom + height + top), facecolor="white")
        total_w, total_h = figure.get_size_inches()
        for i, frame in enumerate(frames):
            ax = figure.add_axes(
                ((i * width + left) / total_w, bottom / total_h, inner / total_w, height / total_h)
            )
            _panel(ax, case, frame, kind, box, inner * 72 / (box[1] - box[0]))
    return figure


def _panel(ax, case, frame, kind, box, scale):
    """One state or path in the axes `ax` with the limits `box`; `scale` points per unit of
    length."""
    from nsbench.report.scenes import particles, plane

    ax.set(xlim=box[:2], ylim=box[2:])
    if kind in ("own", "particles"):
        ax.set_axis_off()
    if not np.all(np.isfinite(frame.x)):
        ax.text(
            0.5,
            0.5,
            "no state: the run failed",
            transform=ax.transAxes,
            ha="center",
            color="#a3241b",
        )
    elif kind == "own":
        find_own_drawing(case.name, case.source)(ax, case, frame.x)
        ax.set(xlim=box[:2], ylim=box[2:])
    else:
        {
            "particles": particles.draw_particles,
            "plane": plane.draw_plane,
            "curves": plane.draw_curves,
        }[kind](ax, case, frame, scale)
    ax.set_title(sanitise(frame.label, 60), loc="left", fontsize=8.0, pad=4.0, x=0.0)


def _limits(case, frames, kind):
    """Limits x0, x1, y0, y1 around everything that the frames show."""
    from nsbench.report.scenes import particles

    if kind == "own":
        from matplotlib.figure import Figure

        ax = Figure().add_subplot()
        for f in frames:
            if np.all(np.isfinite(f.x)):
                find_own_drawing(case.name, case.source)(ax, case, f.x)
        low = ax.dataLim.min
        high = ax.dataLim.max
    else:
        low, high = particles.drawing_extent(case, frames, kind)
    if not np.all(np.isfinite([*low, *high])) or np.any(low > high):
        low = np.zeros(2)
        high = np.ones(2)
    if kind == "plane" and np.max(high - low) < 1e-6:  # a start alone
        low = low - 1.0
        high = high + 1.0
    size = np.maximum(high - low, 1e-9 + 0.02 * np.max(high - low))
    pad = (0.05 if kind in ("own", "particles") else 0.12) * (
        np.full(2, size.max()) if kind != "curves" else size
    )
    if kind == "curves":
        pad[0] = 0.0
    return low[0] - pad[0], high[0] + pad[0], low[1] - pad[1], high[1] + pad[1]


def equalise_scales(
    box: tuple[float, float, float, float], ratio: float
) -> tuple[float, float, float, float]:
    """Widen the box about its middle to height / width = ratio.

    The scales of both axes are equal then without any later adjustment. Returns x0, x1, y0, y1.
    """
    mid = np.array([box[0] + box[1], box[2] + box[3]]) / 2
    size = np.array([box[1] - box[0], box[3] - box[2]])
    width = max(size[0], size[1] / ratio)
    w = 0.5 * width
    h = 0.5 * width * ratio
    return mid[0] - w, mid[0] + w, mid[1] - h, mid[1] + h


def write_svg(figure: Figure) -> str:
    """Write the figure as SVG text: no date, no version, coordinates to a hundredth of a point."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = io.StringIO()
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    out = re.sub(r"<!--.*?-->\s*", "", text.getvalue(), flags=re.DOTALL)
    return re.sub(r' (d|x|y|transform)="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), out)
