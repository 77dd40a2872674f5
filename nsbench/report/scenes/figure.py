"""Pictures of a case and of a trajectory as SVG text: the same input gives the same bytes.

What is drawn follows from the problem: particles with their links and walls; a point in the plane
before its constraints or its switching surface; anything else as curves over time. A case file with
``draw(ax, case, x)`` draws one state itself (it updates the data limits of `ax`; a figure of equal
scale is fitted around them).
"""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from nsbench.case import Case, case_module, load_module
from nsbench.problem import Affine, Complementarity, Distance, Filippov
from nsbench.report.style import INK, sanitise

# widths in inches: 280 px in the page; three panels on 840 px
SINGLE = 3.2
PANEL = 2.7
# strip above for a title, for the name of an axis alone, for nothing
TITLE = 0.24
LABEL = 0.17
BARE = 0.0
RIM = 0.06  # of a scene
AXES = (0.44, 0.36, 0.2)  # room for labels at the left, the bottom and the right
# height over width of a panel stays between these, in the plane below SQUARE
FLAT = 0.4
TALL = 1.3
SQUARE = 1.0
FINE = 400  # points of a known path
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
    """What one panel shows: the state x (n,) at time t, the way there (times (k,), states (k, n)),
    its label."""

    t: float
    x: np.ndarray
    times: np.ndarray
    path: np.ndarray
    label: str = ""


def scene_svg(case: Case, x=None, title: str = "", t: float | None = None) -> str:
    """SVG text of the state x (n,), by default the start, at time t; x may be a whole path
    (len(case.t), n)."""
    return write_svg(scene_figure(case, x, title, t))


def frames_svg(case: Case, traj, times=None) -> str:
    """SVG text of a trajectory: small multiples at `times` (default: start, middle, end), or one
    picture of its path where the surroundings do not move. Samples that a failed run lacks are left
    out and said to be missing."""
    return write_svg(frames_figure(case, traj, times))


def scene_figure(case: Case, x=None, title: str = "", t: float | None = None):
    """The matplotlib Figure behind `scene_svg`."""
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
        times, path = _fine(case, case.t, None)  # a dot alone would say nothing
    return _figure(case, [Frame(t, x, times, path, title)], SINGLE)


def _fine(case, t, x):
    """The path as times and states; finely and with its kinks where x follows the exact solution
    (or is None)."""
    if case.exact is None or (
        x is not None and not np.allclose(case.exact(t), x, rtol=0.0, atol=1e-6)
    ):
        return t, x
    kinks = [e for e in (case.exact_events or ()) if t[0] < e < t[-1]]
    times = np.union1d(np.linspace(t[0], t[-1], FINE), kinks) if len(t) > 1 else t
    return times, np.asarray(case.exact(times))


@dataclass(frozen=True)
class Samples:
    """Times (k,) and states (k, n): as much of a Trajectory as pictures need."""

    t: np.ndarray
    x: np.ndarray


def frames_figure(case: Case, traj, times=None, title: str = ""):
    """The matplotlib Figure behind `frames_svg`."""
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
                float(t[i]), x[i], *_fine(case, t[: i + 1], x[: i + 1]), title or f"t = {t[i]:.3g}"
            )
            for i in index
        ]
    else:
        frames = [Frame(float(t[0]), x[0], *_fine(case, t, x), title)]
    return _figure(case, frames, PANEL if len(frames) > 1 else SINGLE)


def _needs_frames(case: Case) -> bool:
    """Whether the surroundings or the shape change in time, so that one picture of the path does
    not do."""
    what = drawing_kind(case)
    if what == "plane" and isinstance(case.problem, Complementarity):
        return any(c.moving for c in case.problem.constraints if isinstance(c, (Affine, Distance)))
    return what in ("particles", "own")


def drawing_kind(case: Case) -> str:
    """own, particles, plane or curves: how the case is drawn."""
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
    return any(isinstance(c, Distance) and c.dim == 1 for c in p.constraints)


@cache
def find_own_drawing(name: str, source: str):
    """The ``draw`` of the case's file `source`, or None; never that of another case of the same
    name."""
    if not source or not Path(source).is_file():
        return None
    try:
        module = case_module(name)
    except (LookupError, ValueError):
        module = None
    if getattr(module, "__file__", None) != source:
        module = load_module(source)
    return getattr(module, "draw", None)


def _figure(case, frames, width):
    """A Figure with one panel per frame side by side, all on the same scale."""
    import matplotlib
    from matplotlib.figure import Figure

    what = drawing_kind(case)
    left, bottom, right = (RIM, RIM, RIM) if what in ("own", "particles") else AXES
    top = TITLE if any(f.label for f in frames) else BARE if what in ("own", "particles") else LABEL
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # of glyphs that no font here has; the reader's fonts draw them
        box = _limits(case, frames, what)
        inner = width - left - right
        ratio = (box[3] - box[2]) / (box[1] - box[0])
        ratio = (
            0.62
            if what == "curves"
            else float(np.clip(ratio, FLAT, SQUARE if what == "plane" else TALL))
        )
        if what != "curves":
            box = equalise_scales(box, ratio)
        high = inner * ratio
        figure = Figure(figsize=(width * len(frames), bottom + high + top), facecolor="white")
        total_w, total_h = figure.get_size_inches()
        for i, frame in enumerate(frames):
            ax = figure.add_axes(
                ((i * width + left) / total_w, bottom / total_h, inner / total_w, high / total_h)
            )
            _panel(ax, case, frame, what, box, inner * 72 / (box[1] - box[0]))
    return figure


def _panel(ax, case, frame, what, box, scale):
    """One state or path in the axes `ax` with the limits `box`; `scale` points per unit of
    length."""
    from nsbench.report.scenes import particles, plane

    ax.set(xlim=box[:2], ylim=box[2:])
    if what in ("own", "particles"):
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
    elif what == "own":
        find_own_drawing(case.name, case.source)(ax, case, frame.x)
        ax.set(xlim=box[:2], ylim=box[2:])
    else:
        {
            "particles": particles.draw_particles,
            "plane": plane.draw_plane,
            "curves": plane.draw_curves,
        }[what](ax, case, frame, scale)
    ax.set_title(sanitise(frame.label, 60), loc="left", fontsize=8.0, pad=4.0, x=0.0)


def _limits(case, frames, what):
    """x0, x1, y0, y1 around everything the frames show."""
    from nsbench.report.scenes import particles

    if what == "own":
        from matplotlib.figure import Figure

        ax = Figure().add_subplot()
        for f in frames:
            if np.all(np.isfinite(f.x)):
                find_own_drawing(case.name, case.source)(ax, case, f.x)
        low = ax.dataLim.min
        high = ax.dataLim.max
    else:
        low, high = particles.drawing_extent(case, frames, what)
    if not np.all(np.isfinite([*low, *high])) or np.any(low > high):
        low = np.zeros(2)
        high = np.ones(2)
    if what == "plane" and np.max(high - low) < 1e-6:  # a start alone
        low = low - 1.0
        high = high + 1.0
    room = np.maximum(high - low, 1e-9 + 0.02 * np.max(high - low))
    pad = (0.05 if what in ("own", "particles") else 0.12) * (
        np.full(2, room.max()) if what != "curves" else room
    )
    if what == "curves":
        pad[0] = 0.0
    return low[0] - pad[0], high[0] + pad[0], low[1] - pad[1], high[1] + pad[1]


def equalise_scales(box, ratio):
    """The box widened about its middle to height / width = ratio: equal scales without any later
    adjustment."""
    mid = np.array([box[0] + box[1], box[2] + box[3]]) / 2
    size = np.array([box[1] - box[0], box[3] - box[2]])
    width = max(size[0], size[1] / ratio)
    w = 0.5 * width
    h = 0.5 * width * ratio
    return mid[0] - w, mid[0] + w, mid[1] - h, mid[1] + h


def write_svg(figure) -> str:
    """The figure as SVG text: no date, no version, coordinates to a hundredth of a point."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = io.StringIO()
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    out = re.sub(r"<!--.*?-->\s*", "", text.getvalue(), flags=re.DOTALL)
    return re.sub(r' (d|x|y|transform)="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), out)
