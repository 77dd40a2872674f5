"""Read the files of a results folder as untrusted input: bounded lengths, checked forms.

runs.parquet or runs.csv, the descriptions cases.json, solvers.json, env.json and extra.json, and
figures/scene_*.svg and scene_*.json. Only regular files below the folder are read, up to a length;
a table is refused by what its metadata say that it expands to; numbers are checked. Every refusal
is a ValueError that names the file.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nsbench.columns import by_name
from nsbench.report.style import sanitise
from nsbench.results.consistency import MAX_TABLE_BYTES
from nsbench.results.journal import SCHEMA
from nsbench.results.tables import text_of
from nsbench.source_files.regular_files import (
    TooLong,
    UnusableFile,
    exists,
    open_regular,
    read_text,
)

MAX_CELLS = 1 << 27  # rows x columns of a table: more than a million rows, 1 GiB as numbers
MAX_JSON_BYTES = 64 << 20
MAX_SCENE_BYTES = 400_000  # a page of 25 scenes stays below 10 MB
MAX_PLAYER_RUNS = 8
PANDAS_INDEX = "__index_level_"  # columns that pandas adds for an index: no results
NEEDED = {"case", "solver", "status"}  # columns without which a table holds no runs


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_number_or_none(value: object) -> bool:
    return value is None or _is_number(value)


def _are_words(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(v, str) for v in value)


def _are_claims(value: object) -> bool:
    return (
        isinstance(value, dict)
        and all(_is_number_or_none(value.get(k)) for k in ("state", "impulse", "exact"))
        and _is_number(value.get("rounding", 1.0))
    )


def _are_expectations(value: object) -> bool:
    return isinstance(value, list) and all(
        isinstance(e, dict)
        and _are_words(e.get("when"))
        and isinstance(e.get("why"), str)
        and all(
            k in e and (isinstance(e[k], str) or _is_number_or_none(e[k]))
            for k in ("state", "impulse")
        )
        for e in value
    )


def _is_certificate(value: object) -> bool:
    return isinstance(value, dict) and all(
        _is_number_or_none(value.get(k)) for k in ("state", "impulse", "reaction", "event")
    )


# what the report uses of the descriptions of cases, solvers and figures, and what it must be
FIELDS: dict[str, dict[str, Callable[[object], bool]]] = {
    "cases": {
        "classes": _are_words,
        "T": _is_number,
        "n": _is_number,
        "own_length": lambda v: _is_number(v) and float(v) > 0.0,
        "families": lambda v: isinstance(v, str) or _are_words(v),
        "certificate": _is_certificate,
    },
    "solvers": {"claims": _are_claims, "expects": _are_expectations},
    "extra": {"runs": lambda v: isinstance(v, list) and all(isinstance(r, dict) for r in v)},
}


def read_table(folder: Path) -> tuple[Path, dict]:
    """Read runs.parquet, or runs.csv where only that exists: (its path, values by column).

    Values are float64 arrays, or lists. Raises FileNotFoundError where the folder has neither, and
    ValueError.
    """
    for name, read in (("runs.parquet", _read_parquet), ("runs.csv", _read_csv)):
        if exists(folder / name):
            return folder / name, read(folder / name)
    raise FileNotFoundError(f"{folder} holds no runs.parquet and no runs.csv")


def _read_parquet(path: Path) -> dict:
    import pyarrow
    from pyarrow.parquet import ParquetFile

    # opened here: the library cannot open a name that the locale cannot encode
    with open_regular(path, MAX_TABLE_BYTES, path.parent) as file:
        try:
            # a thread of the reader that frees a buffer while Python ends aborts the process
            opened = ParquetFile(file, pre_buffer=False)
            _check_expansion(path, opened.metadata)
            _check_types(path, opened.schema_arrow)
            file.seek(0)
            # text is expanded to one object for each word, not for each row
            table = ParquetFile(
                file,
                read_dictionary=opened.schema_arrow.names,
                page_checksum_verification=True,
                pre_buffer=False,
            ).read(use_threads=False)
            metadata = table.schema.metadata or {}
            _check_schema(path, metadata.get(b"nsbench_schema", b"").decode("ascii", "replace"))
            return {
                name: _values(name, table[name])
                for name in table.column_names
                if not name.startswith(PANDAS_INDEX)
            }
        except UnusableFile:
            raise
        except (OSError, ValueError, KeyError, pyarrow.ArrowException, MemoryError) as e:
            raise UnusableFile(f"{path} cannot be read: {e}") from e


def _check_expansion(path: Path, metadata) -> None:
    """Refuse a table by what its metadata say that it takes in memory."""
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    chunks = [g.column(k) for g in groups for k in range(g.num_columns)]
    size = sum(c.total_uncompressed_size for c in chunks)
    if size > MAX_TABLE_BYTES:
        raise UnusableFile(f"{path} unpacks to {size} bytes; at most {MAX_TABLE_BYTES} are read")
    rows = sum(g.num_rows for g in groups)
    _check_cells(path, max(metadata.num_rows, rows), metadata.num_columns)


def _check_types(path: Path, schema) -> None:
    """Refuse columns of types that no results have, and that expand to more than a value a row."""
    from pyarrow import types

    read = (
        types.is_null,
        types.is_boolean,
        types.is_integer,
        types.is_floating,
        types.is_string,
        types.is_large_string,
    )
    for field in schema:
        kind = field.type.value_type if types.is_dictionary(field.type) else field.type
        if not any(is_read(kind) for is_read in read):
            raise UnusableFile(
                f"{path}: {sanitise(field.name, 80)} is of type {sanitise(field.type, 80)}; "
                "numbers, truth values and text are read"
            )


def _check_cells(path: Path, rows: int, columns: int) -> None:
    """Refuse a table that is too large; columns that are missing are filled, and count."""
    width = max(columns, len(by_name()))
    if rows * width > MAX_CELLS:
        raise UnusableFile(
            f"{path} holds {rows} rows of {columns} columns; at most {MAX_CELLS // width} rows are "
            "read"
        )


def _values(name: str, column) -> np.ndarray | list:
    """Values of a column of a table: an array of numbers, or a list with one object a word."""
    import pyarrow
    from pyarrow import types

    known = by_name()
    is_word = name in known and not known[name].is_number
    if types.is_dictionary(column.type):
        words: list = []
        for chunk in column.chunks:
            distinct = [*chunk.dictionary.to_pylist(), None]
            places = chunk.indices.fill_null(len(distinct) - 1).to_numpy(zero_copy_only=False)
            words += [distinct[i] for i in places]
        return words
    numeric = types.is_floating(column.type) or types.is_integer(column.type)
    if types.is_boolean(column.type) and not is_word:
        column = column.cast(pyarrow.uint8())
        numeric = True
    if numeric and not is_word:
        return column.cast(pyarrow.float64(), safe=False).to_numpy()
    return column.to_pylist()


def _read_csv(path: Path) -> dict:
    with open_regular(path, MAX_TABLE_BYTES, path.parent) as file:
        lines = csv.reader(io.TextIOWrapper(file, encoding="utf-8", newline=""), strict=True)
        try:
            head = [text_of(name) for name in next(lines, [])]
            columns: list[list] = [[] for _ in head]
            words: dict[str, str] = {}  # one object for each
            for row in lines:
                if len(row) > len(head):
                    raise UnusableFile(
                        f"{path}, line {lines.line_num}: {len(row)} values of {len(head)} columns"
                    )
                if row:
                    row += [""] * (len(head) - len(row))
                    for values, value in zip(columns, row, strict=True):
                        values.append(words.setdefault(value, text_of(value)))
                    _check_cells(path, len(columns[0]), len(head))
        except (csv.Error, UnicodeDecodeError, OSError) as e:
            raise UnusableFile(f"{path} cannot be read: {e}") from e
    if head and columns[0] and not set(head) >= NEEDED:
        raise UnusableFile(f"{path} has no column case, solver or status: these are no results")
    return dict(zip(head, columns, strict=True))


def _check_schema(path: Path, found: object) -> None:
    """Refuse a file of another schema; files without one are read."""
    if str(found) not in ("", str(SCHEMA)):
        raise UnusableFile(
            f"{path} is of schema {sanitise(found, 40)}; this version of nsbench reads {SCHEMA}: "
            "run the study again"
        )


def read_notes(path: Path) -> dict:
    """Read a JSON file with the fields that the report relies on; {} if it is missing.

    Raises ValueError, also for a whole number that is no float.
    """
    if not exists(path):
        return {}
    text = read_text(path, MAX_JSON_BYTES, path.parent)
    try:
        value = json.loads(text, parse_int=_whole_number)
    except (ValueError, RecursionError) as e:
        raise UnusableFile(f"{path} cannot be read: {e}") from e
    if not isinstance(value, dict):
        raise UnusableFile(f"{path} holds a {type(value).__name__}; an object is needed")
    if path.name == "env.json":
        _check_schema(path, value.get("schema", ""))
    for name, notes in value.items():
        for what, is_right in FIELDS.get(path.stem, {}).items():
            found = notes.get(what) if isinstance(notes, dict) else None
            if found is not None and not is_right(found):
                raise UnusableFile(
                    f"{path}: {what} of {sanitise(name, 80)} is {sanitise(found, 80)!r}; that is "
                    "no such note"
                )
    return value


def _whole_number(digits: str) -> int:
    value = int(digits)
    if not math.isfinite(float(digits)):
        raise ValueError(f"a number of {len(digits)} digits is too large")
    return value


def read_player(path: Path) -> dict | None:
    """Return the frames of a stored player; None if there are none or too many. Raises ValueError.

    path: DIR/figures/NAME.json. What the script of the page relies on is checked: runs with a
    method, an accuracy and states, and numbers where it computes.
    """
    if not exists(path):
        return None
    try:
        text = read_text(path, MAX_SCENE_BYTES, path.parent.parent)
    except TooLong:
        return None
    try:
        value = json.loads(text, parse_int=_whole_number, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as e:
        raise UnusableFile(f"{path} cannot be read: {e}") from e
    if not _is_player(value):
        raise UnusableFile(f"{path} holds no frames of a player")
    return value


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is no number of JSON")


def _is_player(value: object) -> bool:
    """Does a value have what a player needs?"""
    if not isinstance(value, dict) or value.get("kind") not in ("particles", "plane", "curves"):
        return False
    runs = value.get("runs")
    if not (isinstance(runs, list) and 0 < len(runs) <= MAX_PLAYER_RUNS):
        return False
    box = value.get("box", [])
    known = _are_rows([value.get("t"), box]) and len(box) == 4 * (value["kind"] != "curves")
    return (
        known
        and all(_is_number(value.get(k)) and value[k] > 0 for k in ("unit", "lam_unit"))
        and (value.get("reference") is None or _are_rows(value["reference"]))
        and all(map(_is_player_run, runs))
    )


def _is_player_run(run: object) -> bool:
    return (
        isinstance(run, dict)
        and all(isinstance(run.get(k), str) for k in ("solver", "accuracy", "status", "why"))
        and _is_number(run.get("asked"))
        and run["asked"] > 0
        and _are_rows(run.get("states"))
        and _are_rows(run.get("lam"))
        and isinstance(run.get("contacts"), list)
        and len(run["contacts"]) == len(run["lam"])
        and all(isinstance(run.get(k), list) for k in ("error", "violation"))
        and all(_is_number_or_none(v) for k in ("error", "violation") for v in run[k])
    )


def _are_rows(value: object) -> bool:
    """Is a value a list of lists of numbers?"""
    return isinstance(value, list) and all(
        isinstance(row, list) and all(map(_is_number, row)) for row in value
    )


def scene_files(folder: Path) -> dict[str, Path]:
    """Return the paths of the stored scenes by their stem."""
    return {p.stem: p for p in sorted((folder / "figures").glob("scene_*.svg"))}


def read_scene(path: Path) -> str | None:
    """Return the SVG text of a stored scene; None if it is too long for a page. Raises ValueError.

    path: DIR/figures/NAME.svg.
    """
    try:
        return read_text(path, MAX_SCENE_BYTES, path.parent.parent)
    except TooLong:
        return None
