"""The study `budget`: seconds at equal error, model error, methods taken as their own reference."""

from __future__ import annotations

import numpy as np

from nsbench.report.style import format_number, format_power
from nsbench.studies.budget import costs, model_error
from nsbench.studies.budget.self_reference import compare_references
from nsbench.studies.budget.tables import (
    FACTORS,
    make_figures,
    model_table,
    profile_table,
    references_table,
    seconds_table,
    steps_table,
)
from nsbench.studies.finding import Effort, Finding
from nsbench.studies.parts import Part
from nsbench.studies.registry import find_study

DISCS = (("10", "30", "100"), ("10", "30", "100", "300", "1000", "10000"))
OTHERS = (
    ("chain[growth=1.0]", "rods[n=10]", "hex[n=7]", "corner[psi=60.0]", "epithelium[n=3]"),
    (
        "chain[growth=1.0]",
        "chain[links=20,growth=1.0]",
        "rods[n=10]",
        "hex[n=19]",
        "corner[psi=10.0]",
        "corner[psi=60.0]",
        "kissing[n=30,loops=0.9]",
        "epithelium",
        "epithelium[r_hard=0.7]",
        "teaser",
    ),
)
SECONDS = (0.5, 40.0)  # of runs of each method on each scene
SEEDS = (8, 50)
END = (1, 48)  # hours of the epithelium
TRUTH_SUBSTEPS = (40, 80)
R_HARD = ((0.7,), (0.3, 0.7))
QUOTED = 1e-3  # the error of the sentence to quote
REFUTATION = (
    "A repetition on a quiet machine in which the ratio of the seconds at equal error lies on the "
    "other side of 1, or a numerical error of an observable that exceeds its interval."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study."""
    discs = _measure(effort, DISCS[effort.full])
    others = _measure(effort, OTHERS[effort.full])
    model = [_compare_with_spread(effort, r) for r in R_HARD[effort.full]]
    effort.report("budget: references of one's own")
    references = effort.journal.part("references", compare_references)
    quote = _quote(discs)
    return Finding(
        name="budget",
        question=find_study("budget").question,
        short=_short_answer(discs + others, model),
        answer=quote,
        evidence=_evidence(discs, discs + others, model, references),
        refutation=REFUTATION,
        command=f"nsbench study budget{' --full' * effort.full}",
        tables=(
            steps_table(discs + others),
            seconds_table(discs + others),
            profile_table(discs + others),
            *(model_table(m) for m in model),
            references_table(references),
        ),
        figures=make_figures(discs, references),
        data={
            "scenes": discs + others,
            "model": [{k: v for k, v in m.items() if k != "seeds"} for m in model],
            "references": references,
            "quote": quote,
        },
    )


def _measure(effort: Effort, keys: tuple[str, ...]) -> list[dict]:
    """Measure the costs scene by scene, in this process: nothing else may be at work meanwhile."""
    budget = SECONDS[effort.full]
    out = []
    for key in keys:
        effort.report(f"budget: {key}{' discs' * key.isdigit()}")
        out.append(
            effort.journal.part(
                f"costs {key} {budget}", lambda k=key: costs.measure_scene(k, budget)
            )
        )
    return out


def _compare_with_spread(effort: Effort, r_hard: float) -> dict:
    """Observe all seeds of one variant of the epithelium and compare."""
    end = float(effort.choose(*END))
    substeps = effort.choose(*TRUTH_SUBSTEPS)
    seeds = effort.parts(
        [
            Part(
                f"observe {seed} {end} {r_hard} {substeps}",
                f"budget: epithelium[r_hard={r_hard:g}] to {end:g} h, seed {seed}",
                model_error.observe,
                (seed, end, r_hard, substeps),
            )
            for seed in range(effort.choose(*SEEDS))
        ]
    )
    rows = model_error.compare(seeds)
    return {
        "r_hard": r_hard,
        "end": end,
        "rows": rows,
        "seeds": seeds,
        "count": len(seeds),
        "truth_error": model_error.truth_error(seeds),
        "worst_truth_error": max(s["truth_error"] for s in seeds),
    }


def _spread(values: list[float], digits: int = 2) -> str:
    """Say smallest and largest of the values that are known."""
    known = [v for v in values if np.isfinite(v)]
    if not known:
        return "unknown"
    ends = [format_number(f(known), digits) for f in (min, max)]
    return " to ".join(dict.fromkeys(ends))


def _short_answer(scenes: list[dict], model: list[dict]) -> str:
    """Count the scenes on which PBD is cheaper, and give its largest share of the spread."""
    known = [v for v, _ in (costs.ratio_at(e, QUOTED) for e in scenes) if np.isfinite(v)]
    rows = [r for m in model for r in m["rows"] if r["method"] == "pbd"]
    shares = [r["ratio"] for r in rows if r["ratio"] is not None]
    share = format_number(max(shares), 2) if shares else "an unknown part"
    return (
        f"At an error of {format_power(QUOTED)} PBD is cheaper on {sum(v > 1.0 for v in known)} of "
        f"{len(known)} scenes; its numerical error is at most {share} of the spread over seeds."
    )


def _quote(discs: list[dict]) -> str:
    """Make the sentence that a user may quote, with its numbers."""
    first = discs[0]["scene"]
    last = discs[-1]["scene"]
    ratios = [e["step_ratio"]["median"] for e in discs]
    errors = [costs.error_ratio(e) for e in discs]
    equal = [costs.ratio_at(e, QUOTED) for e in discs]
    by_order = any(extrapolated and np.isfinite(value) for value, extrapolated in equal)
    return (
        f"On {first} to {last} free discs a step of catching-up takes {_spread(ratios)} times as "
        f"long as one of PBD, and at the same step PBD's error is {_spread(errors)} times as "
        f"large: at an error of {format_power(QUOTED)} catching-up takes "
        f"{_spread([value for value, _ in equal])} times the seconds of PBD (above 1 PBD is "
        f"cheaper{'; partly extrapolated by order 1' if by_order else ''}); a factor of 100 at "
        f"equal error was {'' if _largest(equal) >= 100.0 else 'not '}seen."
    )


def _largest(equal: list[tuple[float, bool]]) -> float:
    return max((value for value, _ in equal if np.isfinite(value)), default=float("nan"))


def _evidence(discs, scenes, model, references) -> tuple[str, ...]:
    return (
        _say_crossover(scenes),
        *(_say_profile(scenes, target) for target in costs.TARGETS[1:2]),
        *map(_say_model, model),
        _say_references(references),
        *_say_witnesses(scenes),
        "Seconds are of this machine and of compiled loops of the same kind; ratios come from "
        "interleaved rounds, those of one step with quartiles in the table.",
    )


def _say_witnesses(scenes: list[dict]) -> list[str]:
    """Say how far the truths of many discs are from what confirms them."""
    number = lambda value: format_number(value, 2)
    return [
        f"The true solution of {e['scene']} discs is known to {number(e['truth_error'])}; "
        f"{e['witness']['how']} is {number(e['witness']['distance'])} away from it, within its own "
        f"bound {number(e['witness']['bound'])}."
        for e in scenes
        if e["witness"]
    ]


def _say_crossover(scenes: list[dict]) -> str:
    """Say on which scenes PBD is cheaper, by error."""
    parts = []
    for target in costs.TARGETS:
        known = [(e["scene"], costs.ratio_at(e, target)[0]) for e in scenes]
        known = [(name, value) for name, value in known if np.isfinite(value)]
        cheaper = [name for name, value in known if value > 1.0]
        named = f" ({', '.join(cheaper)})" if cheaper else ""
        parts.append(f"at {format_power(target)} on {len(cheaper)} of {len(known)} scenes{named}")
    return f"PBD is the cheaper one {'; '.join(parts)}. A number alone: so many free discs."


def _say_profile(scenes: list[dict], target: float) -> str:
    shares = costs.profile(scenes, target, FACTORS)
    said = ", ".join(
        f"{m} {100.0 * shares[m][1]:.0f} %" for m in costs.METHODS if shares[m][1] is not None
    )
    error = format_power(target)
    return f"Within a factor of {FACTORS[1]:g} of the cheaper one at {error}: {said}."


def _say_model(m: dict) -> str:
    """Say the largest ratio of numerical error and spread for each method and the middle step."""
    step = sorted({r["h"] for r in m["rows"]})[1]
    said = []
    for method in model_error.METHODS:
        own = [r for r in m["rows"] if r["method"] == method and r["h"] == step]
        said.append(f"{method} {_say_worst_ratio(own)}{_say_steady(own, m['truth_error'])}")
    return (
        f"Epithelium with hard radius {m['r_hard']:g} to {m['end']:g} h, {m['count']} seeds: "
        f"numerical error over the spread over seeds at h = {format_number(step, 3)}: "
        f"{'; '.join(said)}."
    )


def _say_worst_ratio(rows: list[dict]) -> str:
    known = [r for r in rows if r["ratio"] is not None]
    if not known:
        return "without a ratio"
    worst = max(known, key=lambda r: r["ratio"])
    interval = f"[{format_number(worst['low'], 2)}, {format_number(worst['high'], 2)}]"
    return f"at most {format_number(worst['ratio'], 2)} {interval} ({worst['observable']})"


def _say_steady(rows: list[dict], known: float) -> str:
    """Name the largest error of an observable that does not vary over seeds; "" without one."""
    steady = [r for r in rows if r["ratio"] is None and (r["rms"] or 0.0) > known]
    if not steady:
        return ""
    worst = max(steady, key=lambda r: r["rms"])
    error = format_number(worst["rms"], 2)
    return f", and off by {error} in {worst['observable']}, which does not vary over seeds"


def _say_references(references: dict) -> str:
    rows = [r for r in references["rows"] if r["true"]]
    hidden = min((r for r in rows if r["method"] == "pbd"), key=lambda r: r["self"] / r["true"])
    blamed = max(rows, key=lambda r: r["self"] / r["true"])
    return (
        f"On {references['case']} PBD with h = 1e-3 is itself "
        f"{format_number(references['own_error'], 2)} off; taken as the reference it shows "
        f"{format_number(hidden['self'], 2)} in place of {format_number(hidden['true'], 2)} for "
        f"PBD at h = {hidden['h']:g}, and {format_number(blamed['self'], 2)} in place of "
        f"{format_number(blamed['true'], 2)} for {blamed['method']} at h = {blamed['h']:g}."
    )
