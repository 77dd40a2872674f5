"""References that a case lacks: build them, or store the sentence why none can be made.

A case has its own folder for them (`Case.references`); beside the references lies, for a case of
which none could be made, STEM.why.json with the reason and the version of the case.
"""

from __future__ import annotations

import json
from pathlib import Path

from nsbench.case import Case
from nsbench.reference.build import build
from nsbench.reference.lookup import reference
from nsbench.reference.storage import files_of, fingerprint
from nsbench.source_files.regular_files import exists, read_bytes

MAX_REASON_BYTES = 1 << 20
LONGEST_REASON = 400  # characters


def is_missing(case: Case) -> bool:
    """Could the case have a reference, has none, and has nobody tried to build it?"""
    if not case.references or not case.unique or case.exact is not None:
        return False
    return reference(case) is None and not why_missing(case)


def build_missing(case: Case) -> None:
    """Build the reference of a case, or store why there is none."""
    try:
        build(case)
    except Exception as e:  # whatever functions of the case raise is the reason
        first = str(e).splitlines()[0] if str(e) else type(e).__name__
        store_reason(case, first.removeprefix(f"{case.key}: ")[:LONGEST_REASON])


def why_missing(case: Case) -> str:
    """Return why the case has no reference, as a sentence; "" if that is not known."""
    if not case.unique:
        return "the solution is not unique"
    path = _reason_file(case)
    if not case.references or not exists(path):
        return ""
    try:
        stored = json.loads(read_bytes(path, MAX_REASON_BYTES))
        return stored["why"] if stored["fingerprint"] == fingerprint(case) else ""
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def _reason_file(case: Case) -> Path:
    return files_of(case)[1].with_suffix(".why.json")


def store_reason(case: Case, why: str) -> None:
    """Store why the case has no reference: nobody tries again until the case is another."""
    path = _reason_file(case)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"fingerprint": fingerprint(case), "why": why}, indent=1)
    path.write_text(text, encoding="utf-8")
