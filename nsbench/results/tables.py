"""Write the rows of a study as tables: DIR/runs.csv and DIR/runs.parquet."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from nsbench.columns import describe
from nsbench.results.atomic_write import write_atomically
from nsbench.results.journal import SCHEMA
from nsbench.trajectory import utf8_safe

BLOCK = 10_000  # rows that are made a part of a table at a time
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what begins a formula in a spreadsheet


def write_tables(folder: Path, rows: Iterable[dict]) -> dict[str, str]:
    """Write runs.csv and runs.parquet; return the digests of their contents by name.

    rows: an iterable that can be gone through several times; never are all rows in memory as dicts.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = _kinds(pa, rows)
    text = io.StringIO()
    tables = []
    plain = map(_utf8_row, rows)
    w = csv.writer(text, lineterminator="\n")
    w.writerow([cell(c) for c in columns])
    while (block := list(islice(plain, BLOCK))) or not tables:
        w.writerows([cell(r.get(c)) for c in columns] for r in block)
        tables.append(
            pa.table(
                {c: _column(pa, [r.get(c) for r in block], kind) for c, kind in columns.items()}
            )
        )
    files = {"runs.csv": text.getvalue().encode()}
    table = pa.concat_tables(tables).combine_chunks()
    del tables, text
    table = table.cast(pa.schema([table.field(c).with_metadata(_described(c)) for c in columns]))
    sink = pa.BufferOutputStream()
    # with checksums: a page that was damaged on the disk is an error on reading, not another number
    pq.write_table(
        table.replace_schema_metadata({"nsbench_schema": str(SCHEMA)}),
        sink,
        write_page_checksum=True,
    )
    files["runs.parquet"] = sink.getvalue().to_pybytes()
    for name, data in files.items():
        write_atomically(folder / name, data)
    return {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}


def _described(name: str) -> dict[bytes, bytes]:
    """Unit, meaning and owner of a column, for the schema of runs.parquet."""
    column = describe(name)
    return {
        b"unit": column.unit.encode(),
        b"meaning": column.meaning.encode(),
        b"owner": column.owner.encode(),
    }


def cell(value: object) -> object:
    """Return a cell of runs.csv: text that a spreadsheet would take for a formula begins with an
    apostrophe."""
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def text_of(value: str) -> str:
    """Return the text of a cell, without the apostrophe that `cell` added."""
    return (
        value[1:]
        if isinstance(value, str) and value[:1] == "'" and value[1:].startswith(FORMULA)
        else value
    )


def _utf8_row(row: dict) -> dict:
    return {utf8_safe(k): utf8_safe(v) if isinstance(v, str) else v for k, v in row.items()}


def _kinds(pa, rows: Iterable[dict]) -> dict:
    """Return the type of every column by name: truth values, numbers as float64, or text."""
    out: dict[str, int] = {}
    for row in rows:
        for k, v in row.items():
            kind = (
                0 if v is None or isinstance(v, bool) else 1 if isinstance(v, (int, float)) else 2
            )
            out[k] = max(out.get(k, 0), kind)
    types = {}
    for k, kind in out.items():  # names that are the same in UTF-8 are one column
        types[utf8_safe(k)] = max(types.get(utf8_safe(k), 0), kind)
    return {k: (pa.bool_(), pa.float64(), pa.string())[kind] for k, kind in types.items()}


def _column(pa, values, kind):
    """Return a column of this type; missing values are null."""
    if kind == pa.float64():
        return pa.array([None if v is None else float(v) for v in values], kind)
    return pa.array(
        values if kind == pa.bool_() else [None if v is None else str(v) for v in values], kind
    )
