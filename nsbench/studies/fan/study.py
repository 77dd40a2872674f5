"""The study `fan`: which steps make the global error, and how flow and steps change differences."""

from __future__ import annotations

from collections import Counter

import numpy as np

from nsbench import solvers
from nsbench.case import get_case
from nsbench.report.style import format_number
from nsbench.studies.fan.figures import FanCurves, draw_fans, draw_parts
from nsbench.studies.fan.one_step_stability import measure_growth
from nsbench.studies.fan.windermere import (
    CONTACT,
    EVENT,
    FREE,
    PHASES,
    Fan,
    open_fan,
    step_exactly,
)
from nsbench.studies.finding import Effort, EvidenceFigure, EvidenceTable, Finding
from nsbench.studies.parts import Part
from nsbench.studies.registry import find_study

# cases with the end of their fan: after a release, while a hinge folds, on a wall, at rest
SCENES = (
    ("tide", 3.0),
    ("three_discs", 1.5),
    ("wedge[psi=60,swell=0.5]", 0.95),
    ("wedge[psi=60,swell=0.5]", 2.0),
)
METHODS = (("pbd",), ("pbd", "pbd[order=reverse]", "catching_up"))  # small form, full form
STEPS = ((8, 16), (12, 24, 48, 96))
# scenes of one step; steps between two samples, states looked at along the run and around the worst
STEP_SCENES = ("hex[n=7]", "chain", "wedge[psi=60,swell=0.5]", "discs[n=10]")
MORE_STEP_SCENES = ("hex[n=19]", "sliding", "stiff_contact")  # of the full form
STEP_DIVISORS = ((16, 64), (4, 16, 64))
STEP_STATES = (8, 16)
STEP_CLIMBS = (16, 64)
MAX_MISMATCH = 0.01  # of the parts against the global error
ROUNDING = 1e-6  # of a growth, from differences of states
DRAWN_STEPS = 8
DRAWN_SAMPLES = 25  # of a curve of the drawn fan
REFUTATION = (
    "Parts that do not add up to the global error to 1 %, a defect that the flow enlarges without "
    "bound as the step shrinks, or two states that a step of PBD pulls farther apart than its "
    "bound allows."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study. Raises ArithmeticError where parts do not add up to the error."""
    fans = _fans(effort.full)
    found = effort.parts([*fans, *_growths(effort.full)])
    entries = found[: len(fans)]
    growths = found[len(fans) :]
    for e in entries:
        if e["mismatch"] > MAX_MISMATCH:
            raise ArithmeticError(
                f"{e['case']}, {e['method']}, {e['steps']} steps: the parts differ from the error "
                f"by {e['mismatch']:g} of it; at most {MAX_MISMATCH:g} is allowed"
            )
    return Finding(
        name="fan",
        question=find_study("fan").question,
        short=_short_answer(entries),
        answer=_answer(entries, growths),
        evidence=_evidence(entries),
        refutation=REFUTATION,
        command=f"nsbench study fan{' --full' * effort.full}",
        tables=(_shares_table(entries), _orders_table(entries), _growth_table(growths)),
        figures=_figures(entries),
        data={"fans": entries, "growth_of_one_step": growths},
    )


def _fans(full: bool) -> list[Part]:
    return [
        Part(
            f"fan {case} {end} {method} {steps}",
            f"fan: {case} to t = {end:g}, {method}, {steps} steps",
            describe_fan,
            (case, end, method, steps),
        )
        for case, end in SCENES
        for method in METHODS[full]
        for steps in STEPS[full]
    ]


def describe_fan(case: str, end: float, method: str, steps: int) -> dict:
    """Open the fan of one run and return its numbers."""
    fan = open_fan(get_case(case), method, end, steps)
    return {
        "case": case,
        "end": end,
        "method": method,
        "steps": steps,
        "error": float(np.linalg.norm(fan.error)),
        "mismatch": fan.mismatch,
        "growth": _finite(fan.growth),
        "violation": float(np.linalg.norm(fan.violation)),
        "violation_share": _finite(fan.along_error(fan.violation)),
        "shares": {p: _finite(fan.share(p)) for p in PHASES},
        "defects": {p: _finite(fan.largest_defect(p)) for p in PHASES},
        "before_last_event": _finite(fan.share_before_last_event()),
        "times": fan.t.tolist(),
        "parts": _signed_sizes(fan),
        "phases": list(fan.phases),
    }


def _growths(full: bool) -> list[Part]:
    """List the measurements of how far one step pulls states apart: scene, method and step."""
    return [
        Part(
            f"growth {name} {method} {divisor}",
            f"fan: growth in one step, {name}, {method}, spacing / {divisor}",
            _growth_of,
            (name, method, divisor, full),
        )
        for name in STEP_SCENES + MORE_STEP_SCENES * full
        for method in _one_step_methods(get_case(name), full)
        for divisor in STEP_DIVISORS[full]
    ]


def _growth_of(name: str, method: str, divisor: int, full: bool) -> dict:
    return describe_growth(get_case(name), method, divisor, full)


def _one_step_methods(case, full: bool) -> list[str]:
    """List the methods with a fixed step that take the case; PBD alone in the small form."""
    fixed = [s for s in solvers.standard() if solvers.get(s).accuracy == "h"] if full else []
    methods = dict.fromkeys(["pbd", "pbd[order=reverse]"][: 1 + full] + fixed)
    return [m for m in methods if not solvers.get(m).refuses(case)]


def describe_growth(case, method: str, divisor: int, full: bool) -> dict:
    """Measure the growth of one step, the spacing of the samples over `divisor`, in numbers.

    Raises ArithmeticError where a pair of states exceeds what is proven.
    """
    h = float(np.diff(case.t).min()) / divisor
    found = measure_growth(case, method, h, STEP_STATES[full], STEP_CLIMBS[full])
    if found.bound is not None and found.growth > found.bound + ROUNDING:
        raise ArithmeticError(
            f"{method} on {case.key}, h = {h:g}: a step pulls two states apart by "
            f"{found.growth:.9g}, and by at most {found.bound:.9g} by the bound"
        )
    bound = None if found.bound is None else _finite(found.bound)
    return {
        "case": case.key,
        "method": method,
        "h": h,
        "states": found.states,
        "lipschitz": found.lipschitz,
        "growth": found.growth,
        "growth_bound": bound,
        "C": found.constant(found.growth),
        "C_bound": found.constant(bound),
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _signed_sizes(fan: Fan) -> list[float]:
    """Parts along the direction of the global error, as fractions of it; 0.0 of none."""
    return [_finite(fan.along_error(part)) or 0.0 for part in fan.parts]


def _pairs(entries: list[dict]) -> list[tuple[dict, dict]]:
    """Pairs of fans of the same run with the two finest steps."""
    last: dict[tuple, list[dict]] = {}
    for e in entries:
        last.setdefault((e["case"], e["end"], e["method"]), []).append(e)
    return [tuple(group[-2:]) for group in last.values()]


def _short_answer(entries: list[dict]) -> str:
    """Count the scenes by what makes the largest part of the error of PBD at the finest step."""
    finest = {(e["case"], e["end"]): e for e in entries if e["method"] == "pbd"}
    largest = [max(_parts(e), key=_parts(e).get) for e in finest.values()]
    counted = ", ".join(f"{name} on {count}" for name, count in Counter(largest).most_common())
    return (
        f"The largest part of the error of PBD is made by {counted} of {len(largest)} scenes, and "
        f"no defect grew by more than {format_number(_largest_growth(entries), 2)} on its way."
    )


def _parts(entry: dict) -> dict[str, float]:
    """Return the sizes of the parts of an error by what makes them."""
    words = {FREE: "free steps", EVENT: "steps with an event", CONTACT: "steps in contact"}
    shares = {words[p]: abs(entry["shares"][p] or 0.0) for p in PHASES}
    return shares | {"the violation left": abs(entry["violation_share"] or 0.0)}


def _answer(entries: list[dict], growths: list[dict]) -> str:
    finest = {(e["case"], e["end"]): e for e in entries if e["method"] == "pbd"}
    tide = finest[SCENES[0]]
    hinge = finest[SCENES[1]]
    corner = finest[SCENES[3]]
    return (
        f"Under PBD steps in contact make {_percent(hinge['shares']['contact'])} of the error of "
        f"three discs, steps with an event {_percent(hinge['shares']['event'])}; defects from "
        f"before the last event make {_percent(hinge['before_last_event'])} there and "
        f"{_percent(tide['before_last_event'])} on tide, where a contact wipes them out; in the "
        f"corner of the wedge {_percent(corner['violation_share'])} is the violation that the last "
        f"sweep left; no defect grew by more than {format_number(_largest_growth(entries), 2)} "
        f"on its way. {_growth_words(growths)}"
    )


def _growth_words(growths: list[dict]) -> str:
    """Say by how much one step of PBD pulls states apart, at the shortest step of each scene."""
    last = {g["case"]: g for g in growths if g["method"] == "pbd"}
    still = [c for c, g in last.items() if g["growth"] <= 1.0 + ROUNDING and g["C"] is None]
    moved = [
        f"{_number(g['C'])} (at most {_number(g['C_bound'])}) on {c}"
        for c, g in last.items()
        if g["C"] is not None
    ]
    return (
        f"One step pulls two states apart by 1 + C L h, C found and bound {', '.join(moved)}; on "
        f"{' and '.join(still)}, whose drift is the same everywhere, by nothing."
    )


def _number(value: float | None) -> str:
    return "not known" if value is None else format_number(value, 2)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _largest_growth(entries: list[dict]) -> float:
    return max(e["growth"] for e in entries if e["growth"] is not None)


def _evidence(entries: list[dict]) -> tuple[str, ...]:
    worst = max(e["mismatch"] for e in entries)
    return (
        f"Parts and error are computed from different runs of the reference; they agree to "
        f"{format_number(worst, 2)} of the error at worst.",
        "A contact that closes makes the flow forget: defects from before it are carried to the "
        "end as zero where the contact fixes the state.",
    )


def _shares_table(entries: list[dict]) -> EvidenceTable:
    rows = [
        (
            e["case"],
            e["end"],
            e["method"],
            e["steps"],
            e["error"],
            *(e["shares"][p] for p in PHASES),
            e["before_last_event"],
            e["violation_share"],
            e["growth"],
            e["mismatch"],
        )
        for e in entries
    ]
    return EvidenceTable(
        "shares",
        "What the global error is made of",
        (
            "case",
            "end",
            "method",
            "steps",
            "error",
            "from free steps",
            "from steps with an event",
            "from steps in contact",
            "from before the last event",
            "violation left",
            "largest growth",
            "mismatch",
        ),
        tuple(rows),
        "Shares along the error; free, event, contact and violation add up to 1. Growth: carried "
        "over local defect, the largest of all steps. Mismatch: of the sum from the global error, "
        "relative.",
    )


def _orders_table(entries: list[dict]) -> EvidenceTable:
    rows = []
    for coarse, fine in _pairs(entries):
        ratio = fine["steps"] / coarse["steps"]
        orders = []
        for phase in PHASES:
            pair = (coarse["defects"][phase], fine["defects"][phase])
            known = all(v is not None and v > 1e-11 for v in pair)
            orders.append(float(np.log(pair[0] / pair[1]) / np.log(ratio)) if known else None)
        rows.append((fine["case"], fine["end"], fine["method"], fine["steps"], *orders))
    return EvidenceTable(
        "orders",
        "Order of the largest local defect",
        ("case", "end", "method", "steps", "free", "event", "contact"),
        tuple(rows),
        "From the two finest steps; an order of p + 1 is consistency of order p. Where steps with "
        "an event are few, their order scatters with the place of the event within the step.",
    )


def _growth_table(growths: list[dict]) -> EvidenceTable:
    columns = ("case", "method", "h", "states", "L", "growth", "growth at most", "C", "C at most")
    names = ("case", "method", "h", "states", "lipschitz", "growth", "growth_bound", "C", "C_bound")
    return EvidenceTable(
        "growth",
        "How far one step pulls two states apart",
        columns,
        tuple(tuple(g[name] for name in names) for g in growths),
        "|Phi_h x - Phi_h y| = growth |x - y| for the worst pair found around so many feasible "
        "states; growth = 1 + C L h, L the Lipschitz constant of the drift (0: no C). At most: "
        "bound over the balls in which was searched; none is known for other methods than PBD, for "
        "walls or links beside discs, or where two centres could meet.",
    )


def _figures(entries: list[dict]) -> tuple[EvidenceFigure, ...]:
    shown = [e for e in entries if e["method"] == "pbd" and e["steps"] == _finest(entries)]
    return (
        EvidenceFigure(
            "tide",
            f"The fan of PBD on tide with {DRAWN_STEPS} steps: exact solutions from every state of "
            "the method (thin), and the method (points).",
            draw_fans(_tide_curves()),
        ),
        EvidenceFigure(
            "parts",
            "Share of every step in the global error at the end, by what the step holds; after the "
            "dotted line the violation that the last sweep left.",
            draw_parts(shown),
        ),
    )


def _finest(entries: list[dict]) -> int:
    return max(e["steps"] for e in entries)


def _tide_curves() -> FanCurves:
    """Exact solutions of tide from every state of a coarse PBD run."""
    name, end = SCENES[0]
    case = get_case(name)
    t = np.linspace(0.0, end, DRAWN_STEPS + 1)
    from nsbench.solvers import solve

    x = solve(case.replace(t=t, exact=None, exact_impulse=None), "pbd", h=end / DRAWN_STEPS).x
    curves = []
    for n in range(DRAWN_STEPS):
        times = np.linspace(t[n], end, DRAWN_SAMPLES)
        curves.append((times, step_exactly(case, x[n], *times[[0, -1]], times).x[:, 0]))
    return FanCurves(t, x[:, 0], curves)
