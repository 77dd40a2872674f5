"""Tables of the study of multipliers."""

from __future__ import annotations

from nsbench.studies.finding import EvidenceTable
from nsbench.studies.multipliers.settling import PILE_WIDTH, TOLERANCE, last_right


def columns_table(columns: list[dict], growth: dict[str, dict]) -> EvidenceTable:
    """Tabulate steps until the contacts of a column are right."""
    rows = []
    for c in columns:
        floor = c["steps"][-1]
        middle = c["steps"][len(c["steps"]) // 2]
        found = growth.get(c["method"], {})
        rows.append(
            (
                c["n"],
                c["method"],
                c["steps"][0],
                middle,
                floor,
                floor / c["n"] ** 2 if floor is not None else None,
                found.get("power"),
                c["arrived"],
                c["peak"],
            )
        )
    return EvidenceTable(
        "columns",
        "Steps until the multipliers of a column at rest are right",
        (
            "discs",
            "method",
            "topmost contact",
            "middle contact",
            "floor",
            "floor over n^2",
            "power of n",
            "floor, first",
            "highest load",
        ),
        tuple(rows),
        f"Right: within {100 * TOLERANCE:.0f} % of its own load from then on. All discs touch at "
        "the start; gravity sets in at once. 0: right in the first step. First: steps until that "
        "load is reached, for good or not; highest: over its own. Warm: the multipliers of a step "
        "start the next one.",
    )


def piles_table(piles: list[dict], growth: dict[str, dict]) -> EvidenceTable:
    """Tabulate steps until the reactions in a pile are right."""
    rows = []
    for p in piles:
        last = last_right(p)
        over = last / p["n"] ** 2 if last is not None else None
        power = growth.get(p["method"], {}).get("power")
        ends = (p["steps"][0], p["steps"][-1], last)
        rows.append((p["n"], p["discs"], p["method"], *ends, over, power, p["arrived"], p["peak"]))
    return EvidenceTable(
        "piles",
        "Steps until the reactions in a pile at rest are right",
        (
            "rows",
            "discs",
            "method",
            "top row",
            "lowest row",
            "all rows",
            "all over rows^2",
            "power of rows",
            "floor, first",
            "highest load",
        ),
        tuple(rows),
        f"Hexagonal, at most {PILE_WIDTH} discs in a row, between walls: multipliers are not "
        f"unique. Right: within {100 * TOLERANCE:.0f} % of the weight of a disc from then on. "
        "Floor: the sum of its loads, until it first is the weight of all discs.",
    )


def events_table(events: list[dict]) -> EvidenceTable:
    """Tabulate steps after events."""
    return EvidenceTable(
        "events",
        "Steps after an event until all multipliers are right",
        ("case", "method", "h", "event at t", "steps", "steps to the next event"),
        tuple(
            (e["case"], e["method"], e["h"], e["event"], e["steps"], e["available"])
            for e in events
        ),
        f"Right: within {100 * TOLERANCE:.0f} % of the largest multiplier until the next event. "
        "None: not before it.",
    )


def costs_table(costs: list[dict]) -> EvidenceTable:
    """Tabulate errors at equal cost."""
    return EvidenceTable(
        "equal-cost",
        "Steps or sweeps at equal cost",
        (
            "case",
            "order",
            "start",
            "sweeps",
            "h",
            "projections",
            "state error",
            "reaction error",
            "state error at the end",
        ),
        tuple(
            (
                r["case"],
                r["order"],
                r["start"],
                r["sweeps"],
                r["h"],
                r.get("projections"),
                r["state"],
                r["reaction"],
                r["end"],
            )
            for r in costs
        ),
        "The product of steps and sweeps is the same in all rows of a case, where a kept start "
        "counts as one sweep; single sweeps are substeps. Projections: those that moved a state, "
        "and applications of kept multipliers. One permutation stands for the random orders.",
    )


def bars_table(bars: list[dict]) -> EvidenceTable:
    """Tabulate effectivities of error bars."""
    return EvidenceTable(
        "effectivity",
        "Effectivity of error bars",
        ("case", "method", "h", "kind", "state", "reaction", "least ratio at a sample"),
        tuple(
            (r["case"], r["method"], r["h"], r["kind"], r["state"], r["reaction"], r["least"])
            for r in bars
        ),
        "Largest error bar over the largest error. Bounds are proven, estimates are not. Runs "
        "without an error to compare with are left out.",
    )
