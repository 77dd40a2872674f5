"""What a report says of cases and methods beside their rows: what they are, and digests of what
their numbers depend on."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

import numpy as np

from nsbench import solvers
from nsbench.case import Case, get_case


def describe_case(case: Case) -> dict:
    """What a report says of a case: its docstring, size, families, where its reference comes
    from."""
    from nsbench.reference import reference

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
    told = {k: float(v) for k, v in bounds.items() if np.isfinite(v)} | {
        "how": getattr(ref, "how", "")
    }
    return {
        "doc": case.doc,
        "n": case.n,
        "problem": type(p).__name__,
        "reference": kind,
        "certificate": told,
        "tags": list(case.tags),
        "classes": list(case.classes),
        "families": [type(c).__name__ for c in getattr(p, "constraints", ())],
        "T": float(case.t[-1] - case.t[0]),
        "samples": len(case.t),
        "unique": case.unique,
        "digest": _digest(case.key.encode(), *_contents([case.source])),
        "reference_digest": _digest(kind.encode(), *_contents(_stored(case))),
    }


def _stored(case: Case) -> list:
    from nsbench.reference import files_of

    return [] if case.exact is not None else [f for f in files_of(case) if Path(f).exists()]


def _contents(paths) -> list[bytes]:
    """What is in the files, whatever ends their lines."""
    return [Path(p).read_bytes().replace(b"\r\n", b"\n") for p in paths if p]


def _digest(*chunks: bytes) -> str:
    """Sixteen hexadecimal digits of the content."""
    h = hashlib.sha256()
    for c in chunks:
        h.update(len(c).to_bytes(8, "little") + c)
    return h.hexdigest()[:16]


def describe_solver(spec: str) -> dict:
    """What a report says of a solver: its first line, its accuracy parameter and its claims."""
    m = solvers.get(spec)
    return {
        "doc": next(iter((type(m).__doc__ or "").strip().splitlines()), ""),
        "accuracy": m.accuracy,
        "claims": dataclasses.asdict(m.claims),
        "expects": [dataclasses.asdict(e) for e in getattr(m, "expects", ())],
        "digest": _digest(repr(sorted(dataclasses.asdict(m).items())).encode()),
    }


def talk_figure() -> dict:
    """Data of the talk's figure: explicit Euler on `sliding` with dt = 0.2, 0.09, 0.04, and
    implicit beside it."""
    case = get_case("sliding")
    out = {"case": case.key, "t": case.t.tolist(), "exact": case.exact(case.t).tolist(), "runs": []}
    for spec in ("euler", "euler[implicit=true]"):
        for dt in (0.2, 0.09, 0.04):
            nodes = np.arange(0.0, case.t[-1] + 1e-12, dt)
            traj = solvers.solve(dataclasses.replace(case, t=nodes), spec, h=dt)
            out["runs"].append(
                {"solver": spec, "dt": dt, "t": nodes.tolist(), "x": traj.x.tolist()}
            )
    return out
