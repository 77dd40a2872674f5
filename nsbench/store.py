"""What a study leaves on disk: journal, tables, environment; and the keys by which a run is found again."""
from __future__ import annotations

import contextlib
import csv
import functools
import hashlib
import io
import json
import math
import os
import platform
import sys
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

SCHEMA = 1
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "jax", "jaxlib", "diffrax", "equinox", "osqp", "piqp")
NOT_NUMBERS = ("report", "cli.py", "store.py", "execute", "__pycache__")     # cannot change a row's numbers


CLOCK = {                # columns of the clock: unit and meaning; they stand with the columns of runs.parquet
    "setup_seconds": ("s", "preparation, as every call of prepare pays it"),
    "compile_seconds": ("s", "what the first preparation in a process takes beyond: compilation, loading, imports"),
    "seconds": ("s", "the run alone: median over its rounds"),
    "seconds_low": ("s", "lower quartile over its rounds"), "seconds_high": ("s", "upper quartile over its rounds"),
    "seconds_max": ("s", "worst round"),
    "rounds": ("1", "rounds it was timed in, interleaved with the other runs of its case; 1: a long run, timed once"),
    "session": ("", "runs with the same word were timed on one machine in one go"),
    "step_max_seconds": ("s", "slowest step, of solvers that can tell"),
}


class StoreError(Exception):
    """The results folder cannot be used; the message says which file and why."""


def _digest(*chunks: bytes) -> str:
    h = hashlib.sha256()
    for c in chunks:
        h.update(len(c).to_bytes(8, "little") + c)
    return h.hexdigest()


@functools.cache
def package_digest() -> str:
    """Content of every package file that can change a number, cases apart (each case counts for its own runs)."""
    root = Path(__file__).parent
    files = sorted(p for p in root.rglob("*.py") if not set(p.relative_to(root).parts) & {*NOT_NUMBERS, "cases",
                                                                                         "solvers"})
    shared = [p for p in sorted((root / "solvers").glob("*.py")) if p.name in ("__init__.py", "base.py", "start.py")
              or p.name.startswith("_")]
    return _digest(*(p.read_bytes() for p in [*files, *shared]))


@functools.cache
def versions() -> dict[str, str]:
    out = {"python": platform.python_version()}
    for name in LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            out[name] = metadata.version(name)
    return out


@functools.cache
def _file_digest(path: str) -> str:
    return _digest(Path(path).read_bytes()) if path else ""


def key_of(spec, case, solver_file: str, reference_files=()) -> str:
    """Everything that can change a row's numbers: package, case, solver, reference, parameters, versions."""
    parts = {k: v for k, v in asdict(spec).items() if k not in ("file", "solver_files")}
    return _digest(json.dumps(parts, sort_keys=True, default=repr).encode(), package_digest().encode(),
                   json.dumps(versions()).encode(), _file_digest(case.source).encode(),
                   _file_digest(solver_file).encode(), *(_file_digest(str(f)).encode() for f in reference_files))


def clean(row: dict) -> dict:
    """The row with plain Python values; JSON has no NaN and no infinity: they become None and text."""
    out = {}
    for k, v in row.items():
        v = v.item() if hasattr(v, "item") else v
        if isinstance(v, float) and not math.isfinite(v):
            v = None if math.isnan(v) else ("inf" if v > 0 else "-inf")
        out[k] = v
    return out


def restore(row: dict) -> dict:
    numbers = {"inf": math.inf, "-inf": -math.inf}
    return {k: math.nan if v is None else numbers.get(v, v) if isinstance(v, str) else v for k, v in row.items()}


class Journal:
    """DIR/journal.jsonl: one line per run, written and synced as the run ends; half a line is dropped on reading."""

    def __init__(self, folder: Path):
        self.path = folder / "journal.jsonl"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = open(self.path, "ab")           # held open and locked for the whole run
        except OSError as e:
            raise StoreError(f"cannot write to {folder}: {e.strerror}") from None
        self._lock()
        self._mend()

    def _lock(self):
        with contextlib.suppress(ImportError):
            import fcntl
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                self._file.close()
                raise StoreError(f"another run is writing to {self.path.parent}") from None

    def _mend(self):
        """Cut half a line that a killed run left at the end."""
        size = self.path.stat().st_size
        if not size:
            return
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        if whole < size:
            self._file.truncate(whole)

    def append(self, key: str, row: dict) -> None:
        line = json.dumps({"schema": SCHEMA, "key": key, "row": clean(row)}, allow_nan=False)
        self._file.write(line.encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self):
        self._file.close()


def read_journal(folder: Path) -> dict[str, dict]:
    """Rows by key; the last one of a key counts. Lines that cannot be read are dropped."""
    path, out = Path(folder) / "journal.jsonl", {}
    if not path.exists():
        return out
    for line in path.read_bytes().splitlines():
        with contextlib.suppress(ValueError, KeyError, TypeError):
            entry = json.loads(line)
            if entry["schema"] == SCHEMA:
                out[entry["key"]] = restore(entry["row"])
    return out


def write_atomically(path: Path, data: bytes) -> None:
    """Beside, then renamed: no half file is ever seen."""
    tmp = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        tmp.write_bytes(data)
        os.replace(tmp, path)
    except OSError as e:
        tmp.unlink(missing_ok=True)
        raise StoreError(f"cannot write {path}: {e.strerror}") from None


def write_tables(folder: Path, rows: list[dict]) -> None:
    """runs.csv and runs.parquet."""
    columns = list(dict.fromkeys(k for r in rows for k in r))
    text = io.StringIO()
    w = csv.DictWriter(text, columns, lineterminator="\n")
    w.writeheader()
    w.writerows(rows)
    write_atomically(folder / "runs.csv", text.getvalue().encode())
    import pyarrow as pa
    import pyarrow.parquet as pq
    table = pa.table({c: _column(pa, [r.get(c) for r in rows]) for c in columns})
    told = {c: dict(zip((b"unit", b"meaning"), CLOCK[c], strict=True)) if c in CLOCK else None for c in columns}
    table = table.cast(pa.schema([table.field(c).with_metadata(told[c]) for c in columns]))
    sink = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"nsbench_schema": str(SCHEMA)}), sink)
    write_atomically(folder / "runs.parquet", sink.getvalue().to_pybytes())


def _column(pa, values):
    """A column of one type: numbers as float64 (missing: null), everything else as text."""
    known = [v for v in values if v is not None]
    if all(isinstance(v, bool) for v in known):
        return pa.array(values, pa.bool_())
    if all(isinstance(v, (int, float)) for v in known):
        return pa.array([None if v is None else float(v) for v in values], pa.float64())
    return pa.array([None if v is None else str(v) for v in values], pa.string())


def environment(**more) -> dict:
    """Versions and machine, for env.json."""
    load = os.getloadavg() if hasattr(os, "getloadavg") else ()
    return {"schema": SCHEMA, "versions": versions() | {"nsbench": _own_version()}, "platform": platform.platform(),
            "machine": platform.machine(), "cores": os.cpu_count(), "load": [round(v, 2) for v in load],
            "argv": sys.argv[1:], "package": package_digest()[:16], **more}


def _own_version() -> str:
    import nsbench
    return nsbench.__version__
