"""Pictures of every scene: the start, the middle and the end of its reference, or the start
alone."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np

from nsbench.results.atomic_write import replace


def scene_file(key: str) -> str:
    """File name of a case's picture."""
    return f"scene_{re.sub(r'[^A-Za-z0-9_.-]+', '_', key).strip('_')}.svg"


def write_scenes(cases, folder: Path) -> None:
    """DIR/figures/scene_*.svg, one for each case; written anew each time, the same bytes for the
    same reference."""
    from nsbench.reference import reference
    from nsbench.report.scenes.figure import frames_svg, scene_svg
    from nsbench.trajectory import Trajectory

    for case in cases:
        try:
            ref = reference(case)
        except ValueError:
            ref = None  # a stale reference draws nothing; the rows say why
        try:
            if ref is None:
                text = scene_svg(case, case.x0, case.key)
            else:
                none = np.empty((len(case.t), 0))
                traj = Trajectory(case.t, np.asarray(ref.x), (), none, none)
                text = frames_svg(case, traj, case.t[[0, len(case.t) // 2, -1]])
        except Exception as e:  # a case may bring its own drawing: a picture never costs the report
            warnings.warn(f"no picture of {case.key}: {type(e).__name__}: {e}", stacklevel=2)
            continue
        replace(Path(folder) / scene_file(case.key), text.encode())
