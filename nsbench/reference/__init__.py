"""References: the known solution of a case, with a bound of its own error.

A closed form where the case has one, else a stored one: certified (proven in ball arithmetic) or
two runs of different integrators that agree, with a witness where one takes the case.
"""

from __future__ import annotations

from nsbench.reference.build import build, describe_attempt, verify
from nsbench.reference.comparison import bounded_by
from nsbench.reference.lookup import reference
from nsbench.reference.missing import build_missing, is_missing, store_reason, why_missing
from nsbench.reference.reference import (
    Reference,
    canonical,
    closed_form,
    columns_of,
    listed_contacts,
    right_hand_side,
    spread,
)
from nsbench.reference.storage import BadReference, files_of, load, store

__all__ = [
    "BadReference",
    "Reference",
    "bounded_by",
    "build",
    "build_missing",
    "canonical",
    "closed_form",
    "columns_of",
    "describe_attempt",
    "files_of",
    "is_missing",
    "listed_contacts",
    "load",
    "reference",
    "right_hand_side",
    "spread",
    "store",
    "store_reason",
    "verify",
    "why_missing",
]
