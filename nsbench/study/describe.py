"""Describe cases and methods for a report, with digests of what their numbers depend on."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from nsbench import solvers
from nsbench.case import Case, get_case
from nsbench.compilation import disk_cache
from nsbench.dynamics.scaling.estimate import own_length
from nsbench.source_files.regular_files import read_bytes

MAX_BYTES = 1 << 30  # of a case file or a stored reference


def describe_case(case: Case) -> dict:
    """Describe a case: its docstring, size, families, where its reference comes from."""
    from nsbench.reference import reference, why_missing

    p = case.problem
    try:
        ref = reference(case)
        kind = "none" if ref is None else ref.kind
    except ValueError as e:
        ref = None
        kind = f"unusable: {e}"
    bounds = {
        k: getattr(ref, f"{k}_error", np.nan) for k in ("state", "impulse", "reaction", "event")
    }
    certificate: dict[str, object] = {k: float(v) for k, v in bounds.items() if np.isfinite(v)}
    certificate["how"] = why_missing(case) if ref is None else ref.how
    return {
        "doc": case.doc,
        "n": case.n,
        "problem": type(p).__name__,
        "reference": kind,
        "certificate": certificate,
        "tags": list(case.tags),
        "classes": list(case.classes),
        "families": [type(c).__name__ for c in getattr(p, "constraints", ())],
        "T": float(case.t[-1] - case.t[0]),
        "own_length": own_length(case) or None,
        "samples": len(case.t),
        "unique": case.unique,
        "digest": digest_of(case.key, case.source),
        "reference_digest": _digest(kind.encode(), *_contents(_stored(case))),
    }


def digest_of(key: str, source: str) -> str:
    """Return sixteen hexadecimal digits of the key of a case and the contents of its file."""
    return _digest(key.encode(), *_contents([source]))


def _stored(case: Case) -> list:
    from nsbench.reference import files_of

    return [] if case.exact is not None else [f for f in files_of(case) if Path(f).exists()]


def _contents(paths) -> list[bytes]:
    """Return the contents of the files, with one line ending on all systems."""
    return [read_bytes(p, MAX_BYTES).replace(b"\r\n", b"\n") for p in paths if p]


def _digest(*chunks: bytes) -> str:
    """Return sixteen hexadecimal digits of the content."""
    return disk_cache.digest(*chunks)[:16]


def digest_of_method(source: str) -> str:
    """Return sixteen hexadecimal digits of the contents of a method's file, "" for no file."""
    return _digest(*_contents([source])) if source else ""


def _own_file(method: Any) -> str:
    """Return the file of a method that is none of this package; "" for those that are."""
    file = getattr(sys.modules.get(type(method).__module__), "__file__", None) or ""
    return "" if Path(solvers.__file__).parent in Path(file).parents else file


def describe_solver(spec: str) -> dict:
    """Describe a solver: its first line, its accuracy parameter, its claims, and its own file."""
    m: Any = solvers.get(spec)
    return {
        "doc": next(iter((type(m).__doc__ or "").strip().splitlines()), ""),
        "accuracy": m.accuracy,
        "claims": dataclasses.asdict(m.claims),
        "expects": [dataclasses.asdict(e) for e in getattr(m, "expects", ())],
        "digest": _digest(repr(sorted(dataclasses.asdict(m).items())).encode()),
        "source": digest_of_method(_own_file(m)),
    }


def talk_figure() -> dict:
    """Compute the data of the talk's figure: explicit and implicit Euler on `sliding` with steps
    dt = 0.2, 0.09, 0.04."""
    case = get_case("sliding")
    runs = []
    for spec in ("euler", "euler[implicit=true]"):
        for dt in (0.2, 0.09, 0.04):
            nodes = np.arange(0.0, case.t[-1] + 1e-12, dt)
            traj = solvers.solve(dataclasses.replace(case, t=nodes), spec, h=dt)
            runs.append({"solver": spec, "dt": dt, "t": nodes.tolist(), "x": traj.x.tolist()})
    exact = np.asarray(case.exact(case.t)).tolist() if case.exact else []
    return {"case": case.key, "t": case.t.tolist(), "exact": exact, "runs": runs}
