"""Read the rows of a study, with the stored descriptions of its cases, solvers and machine.

Sources: a folder of results (runs.parquet or runs.csv, cases.json, solvers.json, env.json,
extra.json, figures/scene_*.svg), several folders, a Study, a DataFrame, or dict rows.
"""

from __future__ import annotations

import math
import re
import shlex
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from nsbench.columns import by_name, describe, names
from nsbench.measure.compared_multiplier import why_reaction
from nsbench.report.stored_results import (
    read_notes,
    read_player,
    read_scene,
    read_table,
    scene_files,
)
from nsbench.report.style import LEADING_METHOD, file_stem, method_of, sanitise
from nsbench.results.journal import read_journal, read_plan
from nsbench.results.packed_rows import PackedRows

# of single steps, against the exact multiplier at that time
LABELS = ("lam_at_start", "lam_at_mid", "lam_at_end", "lam_mean")
MIN_VIOLATION = 1e-9  # far above rounding, far below any use
DRAWN = ("pictures", "players")  # fields of Data
GOOD = ("ok", "below_reference")  # statuses whose errors are numbers


@dataclass(frozen=True)
class Runs:
    """All runs of one solver on one case, from the coarsest to the finest.

    col: one array (runs,) per column.
    """

    case: str
    solver: str
    col: dict = field(repr=False)

    def __len__(self) -> int:
        return len(self.col["status"])

    @cached_property
    def good(self) -> np.ndarray:
        """Return the mask of the runs whose errors are numbers, (runs,)."""
        return np.isin(self.col["status"], GOOD)

    @property
    def accuracy(self) -> str:
        """Return the name of the accuracy parameter: h, k or tol."""
        return next((a for a in self.col["accuracy"] if a), "h")

    @property
    def loop(self) -> str:
        """Return the kind of the loop over steps: compiled, host, or ""."""
        return next((s for s in self.col["loop"] if s), "")

    @property
    def unique(self) -> bool:
        """Are the multipliers unique, as far as the runs found?"""
        u = self.col["multipliers_unique"]
        return not np.any(u[np.isfinite(u)] == 0)

    @property
    def compared(self) -> str:
        """Return the error that tells of the multipliers: "impulse", or "reaction"."""
        told = "reaction" in self.col["compared"] or not self.unique
        return "reaction" if told else "impulse"

    @property
    def why_reaction(self) -> str:
        """Say in a sentence why the reaction is compared; "" where impulses are."""
        return why_reaction(self.unique, self.compared, self.floor("impulse"))

    @property
    def violates(self) -> bool:
        """Does the step size decide how far constraints are violated?"""
        return self.accuracy == "h" and bool(
            np.any(self.col["feasibility"][self.good] > MIN_VIOLATION)
        )

    def scale(self, metric: str) -> float:
        """Return the size of the quantity that `metric` is the error of; 1 if it is not stored.

        Rounding is relative to it.
        """
        return self._largest(describe(metric).scale, 1.0)

    def relative(self, metric: str, error):
        """Divide an error, or an array of them, by the size of the quantity, at least 1."""
        return error / max(1.0, self.scale(metric))

    def floor(self, metric: str) -> float:
        """Return the error of `metric` below which only the reference's own error is measured.

        0 if the reference is exact, or if there is none.
        """
        return self._largest(describe(metric).floor, 0.0)

    def _largest(self, column: str, otherwise: float) -> float:
        if not column:
            return otherwise
        values = self.col[column][np.isfinite(self.col[column])]
        return float(values.max()) if values.size else otherwise


@dataclass(frozen=True)
class Data:
    """The rows of a study by (case, solver), in the order of the page.

    cases, solvers, env, extra: as stored. pictures: SVG by case. players: frames by case. missing:
    what a study that was interrupted lacks, in words, and lacking: the count alone; else "".
    """

    runs: dict
    cases: dict
    solvers: dict
    env: dict
    extra: dict
    pictures: dict
    players: dict = field(default_factory=dict)
    missing: str = ""
    lacking: str = ""

    @property
    def case_keys(self) -> list[str]:
        """List the cases in the order of the page."""
        return list(dict.fromkeys(case for case, _ in self.runs))

    @property
    def specs(self) -> list[str]:
        """List the solvers, the leading method first."""
        return sorted(
            {solver for _, solver in self.runs}, key=lambda s: (method_of(s) != LEADING_METHOD, s)
        )

    def of_case(self, case: str) -> list[Runs]:
        """List the runs of one case by solver."""
        return [r for (c, _), r in self.runs.items() if c == case]


def read(study: object) -> Data:
    """Read a study, a folder of results (or several), a DataFrame or a list of dict rows.

    Raises FileNotFoundError if a folder holds no rows, and ValueError, which names the file, for
    one that cannot be read.
    """
    if isinstance(study, (str, Path)):
        return _folder(Path(study))
    if (
        isinstance(study, (list, tuple))
        and study
        and all(isinstance(s, (str, Path)) for s in study)
    ):
        return merge([_folder(Path(s)) for s in study])
    rows = getattr(study, "rows", study)
    known = {name: getattr(study, name, None) for name in ("cases", "solvers", "env", "extra")}
    known = {k: v if isinstance(v, dict) else {} for k, v in known.items()}
    return build(columns_of(rows), **known)


def read_unfinished(folder: Path) -> Data:
    """Read the rows of a study that has not written its tables, from the journal of the folder.

    Only rows of the runs that the study planned count; of a journal without a plan, the last row of
    each run. Raises FileNotFoundError where there is none, and ValueError.
    """
    rows, planned = _journalled(folder)
    if not rows:
        raise FileNotFoundError(f"no results in {folder}: no run of the last study has ended yet")
    data = _with_notes(folder, rows, str(folder / "journal.jsonl"))
    argv = data.env.get("argv")
    command = shlex.join(map(str, argv)) if isinstance(argv, list) and argv else "run"
    count = f"{planned - len(rows)} of {planned}" if planned else "an unknown number of"
    lacking = f"{count} planned runs are missing"
    missing = (
        f"{lacking}, because the last study here is going on or was "
        f"interrupted; the same command goes on with them: nsbench {sanitise(command)}"
    )
    return replace(data, missing=missing, lacking="" if planned == len(rows) else lacking)


def _journalled(folder: Path) -> tuple[list[dict], int]:
    """Return the rows of the last study that a journal holds, and how many were planned (0: not
    known)."""
    rows = PackedRows()
    read_journal(folder, into=rows)
    if plan := read_plan(folder):
        return [rows[key] for key in plan if key in rows], len(plan)
    run = lambda row: tuple(str(row.get(n)) for n in ("case", "solver", "accuracy", "asked"))
    return list({run(row): row for row in rows.values()}.values()), 0


def _folder(folder: Path) -> Data:
    path, columns = read_table(folder)
    return _with_notes(folder, columns, str(path))


def _with_notes(folder: Path, rows: object, source: str) -> Data:
    return build(
        columns_of(rows, source),
        *(read_notes(folder / f"{name}.json") for name in ("cases", "solvers", "env", "extra")),
        scene_files(folder),
    )


def merge(parts: list[Data]) -> Data:
    """Merge several folders of results; runs of the same case and solver are put together."""
    runs = [r for d in parts for r in d.runs.values()]
    found = dict.fromkeys(n for r in runs for n in r.col)
    cols = {n: _joined([r.col.get(n) for r in runs], [len(r) for r in runs]) for n in found}
    known = ("cases", "solvers", "env", "extra")
    notes = [{k: v for d in parts for k, v in getattr(d, name).items()} for name in known]
    out = build(cols, *notes)
    drawn = ({k: v for d in parts for k, v in getattr(d, name).items()} for name in DRAWN)
    return Data(out.runs, *notes, *drawn)


def _joined(parts: list, sizes: list[int]) -> np.ndarray:
    """One column of several folders; NaN, or "", where a folder lacks it.

    Where folders disagree on the type, the column becomes text.
    """
    if all(p is None or p.dtype == np.float64 for p in parts):
        filled = [np.full(n, np.nan) if p is None else p for p, n in zip(parts, sizes, strict=True)]
        return np.concatenate(filled or [np.empty(0)])
    words = [[""] * n if p is None else map(_word, p) for p, n in zip(parts, sizes, strict=True)]
    return np.array([w for part in words for w in part], dtype=object)


def _number(value) -> float:
    """A value as a float; true is 1, false is 0, and NaN stands for all that is no number.

    A whole number beyond all floats is infinite.
    """
    if isinstance(value, str):
        value = {"true": 1.0, "false": 0.0}.get(value.lower(), value)
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except (TypeError, ValueError):
        return math.nan


def _word(value) -> str:
    """A value as harmless text; "" for None and NaN."""
    return "" if value is None or value != value else sanitise(value)


def columns_of(rows: object, source: str = "the rows") -> dict:
    """Convert dict rows, a DataFrame or a dict of columns to arrays of all columns.

    Missing values are NaN or "". Columns that are not in nsbench.columns are included: they hold
    numbers if all their values read as such, else words. Seconds of runs on shared workers are set
    to NaN, so that nothing compares them. Raises ValueError, which names the source, for a count
    or flag that is infinite.
    """
    if hasattr(rows, "columns"):
        rows = {name: rows[name].tolist() for name in rows.columns}
    if not isinstance(rows, dict):
        rows = list(rows)
        found = dict.fromkeys([*names(), *(name for r in rows for name in r)])
        rows = {name: [r.get(name) for r in rows] for name in found}
    size = max((len(v) for v in rows.values()), default=0)
    known = by_name()
    out = {}
    for name in (*known, *sorted(n for n in rows if n not in known)):
        values = rows.get(name)
        number = known[name].is_number if name in known else _all_numbers(values)
        if number:
            out[name] = np.full(size, np.nan) if values is None else _numbers(values)
        else:
            out[name] = _words(name, values or (), size)
    for name in names("clock"):
        if known[name].is_number and name != "shared":
            out[name][out["shared"] == 1.0] = math.nan
    _check_counts(out, source)
    return out


def _check_counts(columns: dict, source: str) -> None:
    """Refuse counts and flags that are infinite: they are written as whole numbers."""
    for name, column in by_name().items():
        if column.kind in ("count", "flag") and (wrong := np.isinf(columns[name])).any():
            at = int(np.argmax(wrong))
            raise ValueError(
                f"{source}: {name} of {columns['solver'][at]} on {columns['case'][at]} is "
                f"{columns[name][at]:g}; a {column.kind} is finite"
            )


def _words(name: str, values, size: int) -> np.ndarray:
    """(size,) texts of a column; a case or solver without one is "(unnamed)"."""
    nothing = "(unnamed)" if name in ("case", "solver") else ""
    known: dict = {}  # there are few different words in many rows
    for v in values:
        if isinstance(v, str) and v not in known:
            known[v] = (_word(v).strip() or nothing) if nothing else _word(v)
    words = [known[v] if isinstance(v, str) else _word(v) or nothing for v in values]
    return np.array(words or [nothing] * size, dtype=object)


def _all_numbers(values) -> bool:
    """Does every value of a column read as a number or truth value, where there is one?"""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return True
    some = [v for v in values if v is not None and not (isinstance(v, str) and not v)]
    return bool(some) and all(not math.isnan(_number(v)) or _is_nan(v) for v in some)


def _is_nan(value) -> bool:
    return str(value).lower() == "nan"


def _numbers(values) -> np.ndarray:
    """A column as floats (size,)."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values.copy()
    return np.array([_number(v) for v in values], dtype=np.float64)


def build(cols: dict, cases=None, solvers=None, env=None, extra=None, files=None) -> Data:
    """Group columns by case and solver.

    Cases come in the order of `cases`, then by name; runs from the coarsest to the finest. files:
    paths of stored scenes by their stem.
    """
    cases, solvers = (
        {sanitise(k): v if isinstance(v, dict) else {} for k, v in (d or {}).items()}
        for d in (cases, solvers)
    )
    position = {key: i for i, key in enumerate(cases)}
    groups: dict = {}
    for i, pair in enumerate(zip(cols["case"], cols["solver"], strict=True)):
        groups.setdefault(pair, []).append(i)
    runs = {}
    for pair in sorted(
        groups,
        key=lambda p: (
            position.get(p[0], len(position)),
            p[0],
            method_of(p[1]) != LEADING_METHOD,
            p[1],
        ),
    ):
        rows = np.array(groups[pair])
        h = cols["h"][rows]
        h = np.where(np.isfinite(h), h, cols["asked"][rows])
        rows = rows[np.argsort(np.where(np.isfinite(h), -h, -np.inf), kind="stable")]
        col = {name: values[rows] for name, values in cols.items()}
        runs[pair] = Runs(
            *pair, {**col, "h": np.where(np.isfinite(col["h"]), col["h"], col["asked"])}
        )
    return Data(
        runs,
        cases,
        solvers,
        dict(env or {}),
        dict(extra or {}),
        *_drawn(runs, cases, files or {}),
    )


def _drawn(runs: dict, cases: dict, files: dict) -> tuple[dict, dict]:
    """The stored scene of each case, and the frames of its player beside it.

    The scene is the file its notes name, else ``scene_CASE.svg``.
    """
    pictures = {}
    players = {}
    for case in dict.fromkeys(c for c, _ in runs):
        named = Path(str(cases.get(case, {}).get("picture") or "")).stem
        stems = (
            named,
            f"scene_{file_stem(case)}",
            "scene_" + re.sub(r"[^A-Za-z0-9_.-]+", "_", case).strip("_"),
        )
        path = next((files[s] for s in stems if s in files), None)
        if path is None:
            continue
        scene = read_scene(path)
        if scene is not None:
            pictures[case] = scene
        player = read_player(path.with_suffix(".json"))
        if player is not None:
            players[case] = player
    return pictures, players
