"""Why the reaction is compared in the place of the impulses, in one sentence for all outputs."""

from __future__ import annotations

NOT_UNIQUE = "multipliers not unique: the reaction is compared"
NEARLY = "multipliers nearly not unique"  # begins the sentence where the reference tells too little


def why_reaction(unique: bool, compared: str, impulse_floor: float) -> str:
    """Say why the reaction is compared; "" where the impulses are.

    The arguments are the columns multipliers_unique, compared and impulse_floor of a run.
    """
    if not unique:
        return NOT_UNIQUE
    if compared != "reaction":
        return ""
    known = f"{impulse_floor / 10.0:.2g}"
    return f"{NEARLY}: known to {known} only; the reaction is compared"
