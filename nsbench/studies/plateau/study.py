"""The study `plateau`: orders of PBD on hard configurations, and a search for one that stalls."""

from __future__ import annotations

import numpy as np

from nsbench.report.style import format_number
from nsbench.studies.curves import Curve, Panel, draw_panels
from nsbench.studies.finding import Effort, EvidenceFigure, EvidenceTable, Finding
from nsbench.studies.parts import Part
from nsbench.studies.plateau import adversary
from nsbench.studies.plateau.scenes import FULL, SMALL, Scene, find_scene
from nsbench.studies.registry import find_study
from nsbench.studies.runs.ladders import QUANTITIES, STALLS, convergence, say_verdict

SEED = 31
METHODS = (("pbd",), ("pbd", "pbd[order=reverse]"))  # small form, full form
OCTAVES = (6, 8)
RESTARTS = (6, 60)  # of the search
MOVES = (6, 40)  # local moves of each
WORST_OCTAVES = 2  # more for the worst configuration, whose coarse steps are no resolved ones
DRAWN_SCENES = 6  # curves of a panel
REFUTATION = (
    "A configuration whose error is claimed to level off over the whole ladder and again when the "
    "steps go on to a quarter of the smallest one, in state, impulse or reaction."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study."""
    octaves = effort.choose(*OCTAVES)
    scenes = [(s, m) for s in (FULL if effort.full else SMALL) for m in METHODS[effort.full]]
    values = effort.parts([*(_ladder(*pair, octaves) for pair in scenes), *_searches(effort)])
    entries = [
        {"group": scene.group, **entry}
        for (scene, _), entry in zip(scenes, values, strict=False)
    ]
    found = _join(values[len(scenes) :])
    worst = _follow_worst(effort, found, octaves)
    return Finding(
        name="plateau",
        question=find_study("plateau").question,
        short=_short_answer([*entries, worst]),
        answer=_answer(entries, found, worst),
        evidence=_evidence(entries, found, worst),
        refutation=REFUTATION,
        command=f"nsbench study plateau{' --full' * effort.full}",
        tables=(_verdicts_table([*entries, worst]), _search_table(found)),
        figures=_figures(entries, found),
        data={"ladders": entries, "search": found, "worst": worst, "seed": SEED},
    )


def _ladder(scene: Scene, method: str, octaves: int) -> Part:
    return Part(
        f"ladder {scene} {method} {octaves}",
        f"plateau: {scene.key}, {method}",
        _climb,
        (scene.key, method, scene.first, octaves),
    )


def _climb(key: str, method: str, first: int, octaves: int) -> dict:
    return convergence(find_scene(key), method, first, octaves)


def _searches(effort: Effort) -> list[Part]:
    """List the blocks of the search, one restart of each family."""
    moves = effort.choose(*MOVES)
    families = len(adversary.FAMILIES)
    return [
        Part(
            f"search {block} {moves}",
            f"plateau: search, block {block}",
            adversary.search,
            ([SEED, block], families, moves),
        )
        for block in range(effort.choose(*RESTARTS) // families)
    ]


def _join(blocks: list[dict]) -> dict:
    """Join the blocks of the search."""
    total: dict = {"tried": 0, "measured": 0, "ratios": [], "failed": {}, "best": []}
    for block in blocks:
        for name in ("tried", "measured", "ratios", "best"):
            total[name] = total[name] + block[name]
        for why, count in block["failed"].items():
            total["failed"][why] = total["failed"].get(why, 0) + count
    total["best"].sort(key=lambda a: -a["ratio"])
    return total


def _follow_worst(effort: Effort, found: dict, octaves: int) -> dict:
    """Judge the worst configuration found over a longer ladder, from its coarse steps on."""
    worst = found["best"][0]
    octaves += WORST_OCTAVES
    effort.report(f"plateau: the worst configuration found, {worst['key']}, {worst['method']}")
    arguments = worst["key"], worst["method"], min(adversary.COARSE), octaves
    entry = effort.journal.part(
        f"worst {worst['key']} {worst['method']} {octaves}", lambda: _climb(*arguments)
    )
    return {"group": "worst found", **entry}


def _count(entries: list[dict], verdict: str) -> dict[str, int]:
    return {q: sum(e["verdicts"][q]["verdict"] == verdict for e in entries) for q in QUANTITIES}


def _stalled(entries: list[dict]) -> list[dict]:
    return [e for e in entries if STALLS in (v["verdict"] for v in e["verdicts"].values())]


def _short_answer(entries: list[dict]) -> str:
    stalled = len(_stalled(entries))
    if stalled:
        return f"Yes: {stalled} of {len(entries)} ladders of steps end at a plateau."
    return f"No: none of {len(entries)} ladders of steps ends at a plateau."


def _answer(entries, found, worst) -> str:
    every = [*entries, worst]
    stalled = _stalled(every)
    orders = _count(every, "order")
    defined = {q: sum(e["verdicts"][q]["order"] is not None for e in every) for q in QUANTITIES}
    first = found["best"][0]
    tail = (
        f"an adversarial search over {found['measured']} configurations found e(h/4)/e(h) of at "
        f"most {format_number(first['ratio'], 3)} (1/4 is order 1): {first['key']} under "
        f"{first['method']}, which over the whole ladder has "
        f"{say_verdict(worst['verdicts']['state'])}"
    )
    if stalled:
        names = ", ".join(f"{e['case']} ({e['method']})" for e in stalled)
        return f"It was seen to stall on {names}; {tail}."
    counted = ", ".join(
        f"{q} {orders[q]} of {defined[q]}" for q in QUANTITIES
    )
    return (
        f"No plateau was found: of {len(every)} ladders an order has a verdict in {counted}, none "
        f"stalls, orders of the state are {_range(every)}; {tail}."
    )


def _range(entries: list[dict]) -> str:
    known = [e["verdicts"]["state"] for e in entries]
    known = [v for v in known if v["verdict"] == "order"]
    if not known:
        return "without a verdict"
    low = min(v["low"] for v in known)
    return f"within [{low:.3f}, {max(v['high'] for v in known):.3f}] with their 95 % intervals"


def _evidence(entries, found, worst) -> tuple[str, ...]:
    rest = [
        f"{e['case']} under {e['method']}: {q} {say_verdict(e['verdicts'][q])}"
        for e in entries
        for q in QUANTITIES
        if e["verdicts"][q]["verdict"] not in ("order", "no error defined")
    ]
    ratios = np.array(found["ratios"])
    failed = ", ".join(f"{why}: {count}" for why, count in found["failed"].items())
    level = float(np.median(ratios))
    return (
        f"Ladders without an order: {'; '.join(rest) or 'none'}.",
        f"Search: median e(h/4)/e(h) {format_number(level, 4)}, largest "
        f"{format_number(float(ratios.max()), 4)}; "
        f"{found['tried'] - found['measured']} of {found['tried']} configurations gave no ratio"
        f"{f' ({failed})' if failed else ''}.",
        "Impulses have no error where contacts are redundant: the order of the sweep selects one "
        "of many; the reaction stands for them there.",
        "Nothing is proven by this: it is the outcome of these configurations and this search.",
    )


def _verdicts_table(entries: list[dict]) -> EvidenceTable:
    rows = [
        (
            e["group"],
            e["case"],
            e["method"],
            *(say_verdict(e["verdicts"][q]) for q in QUANTITIES),
            e["verdicts"]["state"].get("constant"),
            e["rows"][-1].get("state"),
            e["rows"][-1]["h"],
            e["truth"],
        )
        for e in entries
    ]
    return EvidenceTable(
        "verdicts",
        "Verdicts over the ladders",
        (
            "configuration",
            "case",
            "method",
            "state",
            "impulse",
            "reaction",
            "constant of the state",
            "finest state error",
            "finest h",
            "true solution",
        ),
        tuple(rows),
        "Order with its 95 % interval, or what stands for it. A ladder that stalls was continued "
        "to a quarter of its smallest step. Corner: two walls under psi degrees.",
    )


def _search_table(found: dict) -> EvidenceTable:
    return EvidenceTable(
        "search",
        "Worst configurations of the search",
        ("family", "configuration", "method", "e(h/4) / e(h)", "e(h)"),
        tuple(
            (a["family"], a["key"], a["method"], a["ratio"], a["error"])
            for a in found["best"][:20]
        ),
        f"Best of each restart, sorted. e: largest state error at {len(adversary.COARSE)} steps "
        f"near h = spacing of samples / {adversary.COARSE[0]}.",
    )


def _figures(entries: list[dict], found: dict) -> tuple[EvidenceFigure, ...]:
    groups: dict[str, list[dict]] = {}
    for e in entries:
        if e["method"] == METHODS[False][0]:
            groups.setdefault(e["group"], []).append(e)
    panels = [
        Panel(
            group,
            tuple(
                Curve(e["case"], *_column(e["rows"], "state")) for e in members[:DRAWN_SCENES]
            ),
            "h",
            "largest state error",
        )
        for group, members in groups.items()
    ]
    ratios = sorted(found["ratios"])
    share = (np.arange(len(ratios)) + 1.0) / len(ratios)
    seen = Panel(
        "search",
        (
            Curve("configurations tried", ratios, share.tolist()),
            Curve("order 1", (0.25, 0.25), (0.0, 1.0), guide=True),
        ),
        "e(h/4) / e(h)",
        "share of configurations at most",
        x_log=False,
        y_log=False,
    )
    return (
        EvidenceFigure(
            "ladders",
            "State error of PBD over the step, by configuration; last panel: distribution of the "
            "error ratio over all configurations of the search.",
            draw_panels([*panels, seen]),
        ),
    )


def _column(rows: list[dict], name: str) -> tuple[list, list]:
    return [r["h"] for r in rows], [r.get(name) for r in rows]
