"""Write the picture of every case: start, middle and end of its reference, or the start alone."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from nsbench.case import Case
from nsbench.results.atomic_write import replace


def scene_file(key: str) -> str:
    """Return the file name of a case's picture."""
    return f"scene_{re.sub(r'[^A-Za-z0-9_.-]+', '_', key).strip('_')}.svg"


def write_scenes(cases: Iterable[Case], folder: Path) -> None:
    """Write FOLDER/scene_*.svg, one for each case; the same reference gives the same bytes.

    A picture that cannot be drawn is left out with a warning: a case may bring its own drawing, and
    its failure must not cost the report.
    """
    from nsbench.reference import reference
    from nsbench.report.scenes.figure import frames_svg, scene_svg
    from nsbench.trajectory import Trajectory

    for case in cases:
        try:
            ref = reference(case)
        except ValueError:
            ref = None  # a stale reference is not drawn; the rows report why
        try:
            if ref is None:
                text = scene_svg(case, case.x0, case.key)
            else:
                none = np.empty((len(case.t), 0))
                traj = Trajectory(case.t, np.asarray(ref.x), (), none, none)
                text = frames_svg(case, traj, case.t[[0, len(case.t) // 2, -1]])
        except Exception as e:
            warnings.warn(f"no picture of {case.key}: {type(e).__name__}: {e}", stacklevel=2)
            continue
        replace(Path(folder) / scene_file(case.key), text.encode())
