"""Film of a run as an animated GIF: one panel for each sample, all with the same limits."""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np

from nsbench.case import Case
from nsbench.report.scenes.figure import STYLE, Frame, film_panel
from nsbench.trajectory import Trajectory

MOST_FRAMES = 120
DOTS = 120  # per inch
LENGTH = 6000  # milliseconds, of a film in which no frame is shorter or longer than these:
SHORTEST = 40
LONGEST = 200


def film_gif(case: Case, traj: Trajectory) -> bytes:
    """Draw the samples of a run (at most 120, evenly spaced), as an animated GIF that repeats.

    The same run gives the same bytes. Raises ValueError for a run without two finite samples.
    """
    from PIL import Image

    frames = _frames(traj)
    if len(frames) < 2:
        raise ValueError(f"a film needs two samples of a run: {traj.status}")
    first, *others = (Image.fromarray(picture) for picture in _pictures(case, frames))
    out = io.BytesIO()
    each = int(np.clip(LENGTH / len(frames), SHORTEST, LONGEST))
    first.save(out, "GIF", save_all=True, append_images=others, duration=each, loop=0)
    return out.getvalue()


def _frames(traj: Trajectory) -> list[Frame]:
    """List the samples shown, each with the path to it."""
    finite = np.flatnonzero(np.isfinite(traj.x).all(axis=1))
    count = min(len(finite), MOST_FRAMES)
    kept = finite[np.linspace(0, len(finite) - 1, count).round().astype(int)] if count else finite
    return [
        Frame(float(traj.t[i]), traj.x[i], traj.t[: i + 1], traj.x[: i + 1], f"t = {traj.t[i]:.3f}")
        for i in kept
    ]


def _pictures(case: Case, frames: list[Frame]) -> Iterator[np.ndarray]:
    """Draw each frame as pixels (rows, columns, 3)."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    for frame in frames:
        figure = film_panel(case, frame, frames)
        figure.set_dpi(DOTS)
        canvas = FigureCanvasAgg(figure)
        with matplotlib.rc_context(STYLE):
            canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[..., :3]
