"""Storage of references: NAME.npz holds the arrays, NAME.json their origin, own error and checksum.

A stored reference belongs to one version of a case: start, sample times, parameters and the text of
the case file (without comments and docstrings) are stored with it, and one made for another version
is refused with a sentence.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import os
import re
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from nsbench.case import Case, format_value
from nsbench.reference.reference import Reference
from nsbench.source_files.regular_files import exists, read_bytes
from nsbench.trajectory import Event

FORMAT = 1
ENOUGH = 1 << 30  # bytes: a thousand samples of ten thousand discs are 160 MB
MAX_JSON_BYTES = 64 << 20  # of a description, with its contacts and events
BOUNDS = ("state_error", "impulse_error", "reaction_error")
KINDS = ("stored", "certified")


class BadReference(ValueError):
    """Report a stored reference that is broken or belongs to another version of its case; names the
    file.
    """


class OtherVersion(BadReference):
    """Report a stored reference that is whole, but belongs to another version of its case."""


def home() -> Path:
    import nsbench.reference_solutions as package

    return Path(next(iter(package.__path__)))


def stem(case: Case) -> str:
    """Return the file-safe form of the case's key: ``discs_n30_seed0``."""
    parts = [case.name, *(f"{k}{format_value(v)}" for k, v in case.params.items())]
    return re.sub(r"[^A-Za-z0-9_.+-]", "-", "_".join(parts))


def files_of(case: Case, folder: str | Path | None = None) -> tuple[Path, Path]:
    """Return the paths of the arrays and of the description, whether they exist or not."""
    base = Path(folder or case.references or home())
    return base / f"{stem(case)}.npz", base / f"{stem(case)}.json"


def source_hash(path: str) -> str:
    """Compute the sha256 of a case file without comments, docstrings and blank lines; "" without a
    file.
    """
    if not path or not Path(path).is_file():
        return ""
    text = Path(path).read_text(encoding="utf-8").replace("\r\n", "\n")
    lines = text.split("\n")
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
            and ast.get_docstring(node) is not None
        ):
            for k in range(node.body[0].lineno - 1, node.body[0].end_lineno):
                lines[k] = ""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    kept = "\n".join(s.rstrip() for s in lines if s.strip())
    return hashlib.sha256(kept.encode()).hexdigest()


def fingerprint(case: Case) -> dict:
    """Collect what a stored reference must agree with, besides x0 and t."""
    return {
        "case": case.key,
        "n": case.n,
        "problem": type(case.problem).__name__,
        "source": source_hash(case.source),
    }


def _checksum(arrays: dict, meta: dict) -> str:
    """Compute the sha256 of arrays and description together."""
    digest = hashlib.sha256(
        json.dumps({k: v for k, v in meta.items() if k != "checksum"}, sort_keys=True).encode()
    )
    for name in sorted(arrays):
        a = np.ascontiguousarray(arrays[name], "<f8")
        digest.update(f"{name}{a.shape}".encode())
        digest.update(a.tobytes())
    return digest.hexdigest()


def store(case: Case, ref: Reference, folder: str | Path | None = None) -> Path:
    """Write both files atomically; return the path of the arrays."""
    arrays = {"t": ref.t, "x0": case.x0, "x": ref.x}
    arrays |= {
        k: v for k, v in (("impulse", ref.impulse), ("reaction", ref.reaction)) if v is not None
    }
    bounds = {k: float(getattr(ref, k)) for k in BOUNDS}
    events = (
        None
        if ref.events is None
        else [[float(e.t), e.kind, list(map(int, e.contact))] for e in ref.events]
    )
    meta = {
        "format": FORMAT,
        "fingerprint": fingerprint(case),
        "how": ref.how,
        "versions": ref.versions,
        "contacts": [list(map(int, c)) for c in ref.contacts],
        "events": events,
        **{k: None if np.isnan(v) else v for k, v in bounds.items()},
    }
    meta |= {
        "kind": ref.kind,
        "event_error": None if np.isnan(ref.event_error) else float(ref.event_error),
    }
    if ref.shown:
        meta["shown"] = ref.shown
    meta["checksum"] = _checksum(arrays, meta)
    npz, js = files_of(case, folder)
    npz.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    for path, data in (
        (npz, buffer.getvalue()),
        (js, (json.dumps(meta, indent=1) + "\n").encode()),
    ):
        part = path.with_name(f".{path.name}.{os.getpid()}")
        part.write_bytes(data)
        os.replace(part, path)
    return npz


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file. Raises ValueError where it, or what it unpacks to, is far larger
    than any reference.
    """
    data = read_bytes(path, ENOUGH)
    with zipfile.ZipFile(io.BytesIO(data)) as z:
        size = sum(i.file_size for i in z.infolist())
    if size > ENOUGH:
        raise ValueError(f"{path.name} unpacks to {size} bytes; at most {ENOUGH} are read")
    with np.load(io.BytesIO(data), allow_pickle=False) as z:
        return {k: z[k] for k in z.files}


# What reading a damaged archive or description may raise
READ_ERRORS = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    RecursionError,
    MemoryError,
    NotImplementedError,
    zlib.error,
    zipfile.BadZipFile,
)


def load(case: Case, folder: str | Path | None = None) -> Reference | None:
    """Load the stored reference of a case; None if there is none.

    Raises BadReference if it is broken, or belongs to another version of the case.
    """
    npz, js = files_of(case, folder)
    if not exists(npz) and not exists(js):
        return None
    meta, arrays = _read_checked(npz, js)
    wrong = _differing_parts(case, meta, arrays)
    if wrong:
        raise OtherVersion(
            f"the reference {npz} was made for another version of {case.key} "
            f"({', '.join(wrong)} differ): build it again with `nsbench reference build "
            f'"{case.key}"`'
        )
    bounds = {k: float("nan") if meta[k] is None else float(meta[k]) for k in BOUNDS}
    kind = meta.get("kind", "stored")
    if kind not in KINDS:
        raise BadReference(
            f"the reference {npz} is of the kind {kind!r}; one of {', '.join(KINDS)}"
        )
    events = meta["events"]
    if events is not None:
        events = tuple(Event(t, k, tuple(c)) for t, k, c in events)
    event_error = meta.get("event_error")
    return Reference(
        case.t,
        arrays["x"],
        tuple(map(tuple, meta["contacts"])),
        arrays.get("impulse"),
        arrays.get("reaction"),
        events,
        **bounds,
        kind=kind,
        how=meta["how"],
        versions=meta["versions"],
        event_error=float("nan") if event_error is None else float(event_error),
        shown=meta.get("shown", {}),
    )


def _read_checked(npz: Path, js: Path) -> tuple[dict, dict]:
    """Read description and arrays; raise BadReference if they are damaged or were edited."""
    try:
        meta = json.loads(read_bytes(js, MAX_JSON_BYTES))
        arrays = _read_npz(npz)
        dict(meta["fingerprint"])
        stated = meta["checksum"]
        computed = _checksum(arrays, meta)
    except READ_ERRORS as e:
        raise BadReference(
            f"the reference {npz} with {js.name} cannot be read: {type(e).__name__}: {e}"
        ) from None
    if stated != computed:
        raise BadReference(
            f"the reference {npz} does not match the checksum in {js.name}: it was damaged or "
            f"edited"
        )
    return meta, arrays


def _differing_parts(case: Case, meta: dict, arrays: dict) -> list[str]:
    """List what differs between the case and the version that a reference was made for."""
    stored = dict(meta["fingerprint"])
    wrong = [k for k, v in fingerprint(case).items() if stored.get(k) != v]
    if meta["format"] != FORMAT:
        wrong.append("format")
    for name, mine in (("t", case.t), ("x0", case.x0)):
        a = arrays[name]
        # starts are computed by their case: another machine may round them differently
        allowed = 1e-13 * max(1.0, np.abs(mine).max(initial=0.0))
        if a.shape != mine.shape or np.abs(a - mine).max(initial=0.0) > allowed:
            wrong.append(name)
    return wrong
