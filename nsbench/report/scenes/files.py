"""Write the picture of every case and the frames of its player.

The picture shows start, middle and end of the reference, or the start alone; the player moves.
"""

from __future__ import annotations

import contextlib
import json
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from nsbench.case import Case
from nsbench.results.atomic_write import replace


Accuracies = Mapping[str, Sequence[float]]  # by method


def scene_file(key: str) -> str:
    """Return the file name of a case's picture."""
    return f"scene_{re.sub(r'[^A-Za-z0-9_.-]+', '_', key).strip('_')}.svg"


def player_file(key: str) -> str:
    """Return the file name of the frames of a case's player."""
    return scene_file(key).removesuffix(".svg") + ".json"


def write_scenes(cases: Iterable[Case], folder: Path, asked: Accuracies | None = None) -> None:
    """Write FOLDER/scene_*.svg, one for each case; the same reference gives the same bytes.

    asked: accuracies of the study by method. With them scene_*.json, the frames of a player, are
    written too, for which some of these runs are made again: in a process with a limit of time.
    What cannot be drawn is left out with a warning: a case may bring its own drawing, and its
    failure must not cost the report.
    """
    for case in cases:
        states = _reference_states(case)
        with _warning_of(f"no picture of {case.key}"):
            replace(Path(folder) / scene_file(case.key), _picture(case, states).encode())
        if asked:
            with _warning_of(f"no player of {case.key}"):
                _write_player(case, states, folder, asked)


@contextlib.contextmanager
def _warning_of(what: str) -> Iterator[None]:
    """Turn an exception into a warning that says what is missing."""
    try:
        yield
    except Exception as e:
        warnings.warn(f"{what}: {type(e).__name__}: {e}", stacklevel=2)


def _reference_states(case: Case) -> np.ndarray | None:
    from nsbench.reference import reference

    try:
        ref = reference(case)
    except ValueError:
        return None  # a stale reference is not drawn; the rows report why
    return None if ref is None else np.asarray(ref.x)


def _picture(case: Case, states: np.ndarray | None) -> str:
    from nsbench.report.scenes.figure import frames_svg, scene_svg
    from nsbench.trajectory import Trajectory

    if states is None:
        return scene_svg(case, case.x0, case.key)
    none = np.empty((len(case.t), 0))
    traj = Trajectory(case.t, states, (), none, none)
    return frames_svg(case, traj, case.t[[0, len(case.t) // 2, -1]])


def _write_player(
    case: Case, states: np.ndarray | None, folder: Path, asked: Accuracies
) -> None:
    """Write the frames of a player, or remove those of an earlier study."""
    from nsbench.report.scenes.player import build_player, choose_runs

    runs = choose_runs(case, asked)
    player = build_player(case, states, runs) if runs else None
    path = Path(folder) / player_file(case.key)
    if player is None:
        path.unlink(missing_ok=True)
    else:
        replace(path, format_player(player).encode())


def format_player(player: dict) -> str:
    """Format the frames of a player as JSON text."""
    return json.dumps(player, separators=(",", ":"), allow_nan=False)
