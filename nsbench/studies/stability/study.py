"""The study `stability`: maps of status and error; columns and piles held for many steps."""

from __future__ import annotations

from collections import Counter

import numpy as np

from nsbench.report.style import format_number
from nsbench.studies.curves import Curve, Panel, draw_panels
from nsbench.studies.finding import Effort, EvidenceFigure, Finding
from nsbench.studies.parts import Part
from nsbench.studies.plateau.scenes import find_scene
from nsbench.studies.registry import find_study
from nsbench.studies.stability.held_stack import COLUMN, PILE, hold
from nsbench.studies.stability.maps import DIVISORS, MAPS, Map, fill_row, methods_of
from nsbench.studies.stability.tables import (
    failures_table,
    holds_table,
    is_sound,
    map_table,
    show,
)

HOLDS = (  # rows and steps of columns: small form, full form
    ((10, 1000), (30, 1000), (100, 1000)),
    ((10, 10**5), (30, 10**5), (100, 10**5), (1000, 10**5)),
)
PILES = (  # of piles: 10, 28 discs; 91, 300 and 990 more
    ((4, 1000), (7, 1000)),
    ((4, 10**5), (7, 10**5), (13, 10**5), (24, 10**5), (44, 10**5)),
)
# Methods whose steps cost more than a sweep hold a pile for DISC_STEPS / discs steps at most, those
# that choose steps by error bars none of more than MOST_DISCS: 300 discs take hours.
BY_ERROR_BARS = ("catching_up[tol=1e-2]", "pbd[tol=1e-2]")
DISC_STEPS = {
    "catching_up": 4 * 10**7,
    "event_driven": 10**6,
    "penalty": 10**6,
    **dict.fromkeys(BY_ERROR_BARS, 10**6),
}
MOST_DISCS = 100
DIVISORS_OF_PILE = (13, (1, 2, 4))  # rows of a pile, divisors of its step under PBD
HELD_BY = ("pbd", "pbd[order=reverse]", "pbd[sweeps=8]", "catching_up", "event_driven")
REST = 1e-9  # radii in one step: where no disc moves further, a column or pile has come to rest
SILENT = 0.1  # of the motion: an error above it under the status ok is worth a warning
REFUTATION = (
    "A cell with the status ok whose error does not belong to the step, or a failure without a "
    "sentence; a stack that drifts or jitters after the load has reached the floor; a pile that "
    "topples under PBD at one step and at every shorter one."
)


def conduct(effort: Effort) -> Finding:
    """Conduct the study. Raises ArithmeticError for a cell that is neither number nor failure."""
    rows = [(m, value, key) for m in MAPS for value, key in m.scenes(effort.full).items()]
    columns = _columns(effort.full)
    heaps = _piles(effort.full)
    finer = _finer_piles()
    filled = effort.parts([*(_row(*row) for row in rows), *columns, *heaps, *finer])
    ends = np.cumsum([len(rows), len(columns), len(heaps)])
    holds = filled[ends[0] : ends[1]]
    piles = filled[ends[1] : ends[2]]
    ladder = filled[ends[2] :]
    maps: dict[str, dict[float, list[dict]]] = {m.name: {} for m in MAPS}
    for (m, value, _), found in zip(rows, filled, strict=False):
        maps[m.name][value] = found
    cells = [(m, v, c) for m in MAPS for v, row in maps[m.name].items() for c in row]
    for m, value, cell in cells:
        if cell["error"] is None and not cell["sentence"]:
            raise ArithmeticError(f"{m.name} {value}: {cell['method']} has no error and no reason")
    return Finding(
        name="stability",
        question=find_study("stability").question,
        short=_short_answer(cells, holds),
        answer=f"{_answer(cells, holds)}; {_piles_answer(piles, ladder)}.",
        evidence=(
            *_evidence(cells, holds),
            *_sweeps_evidence(cells),
            *_piles_evidence(piles),
            *_ladder_evidence(ladder),
        ),
        refutation=REFUTATION,
        command=f"nsbench study stability{' --full' * effort.full}",
        tables=(
            *(map_table(m, maps[m.name]) for m in MAPS),
            failures_table(cells),
            holds_table("stacks", "A column of discs that must stay still", holds),
            holds_table("piles", "A pile of discs between walls that must stay still", piles),
            holds_table("pile-steps", "A pile of discs by the length of the step", ladder),
        ),
        figures=_figures(maps, holds, piles, ladder),
        data={
            "maps": {n: {str(v): r for v, r in m.items()} for n, m in maps.items()},
            "stacks": holds,
            "piles": piles,
            "pile_steps": ladder,
        },
    )


def _holders(key: str, full: bool) -> list[str]:
    """List the methods that hold a scene; in the full form with all standard ones that can."""
    more = methods_of(find_scene(key)) if full else []
    return list(dict.fromkeys([*HELD_BY, *more]))


def _row(m: Map, value: float, key: str) -> Part:
    methods = m.methods(value)
    if methods is None:
        return Part(f"map {key}", f"stability: map {m.name}, {key}", fill_row, (key,))
    words = f"stability: map {m.name}, {key}, {value:g}"
    return Part(f"map {m.name} {key} {value:g}", words, fill_row, (key, methods))


def _columns(full: bool) -> list[Part]:
    return [
        _held(COLUMN.format(n), n, steps, method, f"{n} discs")
        for n, steps in HOLDS[full]
        for method in _holders(COLUMN.format(HOLDS[full][0][0]), full)
    ]


def _piles(full: bool) -> list[Part]:
    parts = []
    for rows, steps in PILES[full]:
        key = PILE.format(rows)
        discs = rows * (rows + 1) // 2
        for method in _holders(key, full):
            most = _most_steps(method, discs)
            count = steps if most is None else min(steps, most)
            parts.append(_held(key, rows, count, method, f"a pile of {discs} discs"))
    return parts


def _most_steps(method: str, discs: int) -> int | None:
    """Return how many steps of a pile a method may take, None: any number."""
    if method in BY_ERROR_BARS and discs > MOST_DISCS:
        return 0
    return DISC_STEPS[method] // discs if method in DISC_STEPS else None


def _finer_piles() -> list[Part]:
    """Hold one pile for the same time with shorter and shorter steps."""
    rows, divisors = DIVISORS_OF_PILE
    steps = PILES[False][0][1]
    return [
        _held(PILE.format(rows), rows, steps * n, method, f"{rows} rows", n)
        for method in ("pbd", "pbd[sweeps=8]")
        for n in divisors
    ]


def _held(key: str, rows: int, steps: int, method: str, words: str, divisor: int = 1) -> Part:
    return Part(
        f"hold {key} {steps} {method} {divisor}",
        f"stability: {words} held by {method} for {steps} steps",
        hold,
        (key, rows, steps, method, divisor),
    )


def _sound_under_pbd(cells) -> dict[bool, list[float]]:
    """Return h K of the cells of PBD on the map of stiffness: of those that end well, and not."""
    out: dict[bool, list[float]] = {True: [], False: []}
    for m, value, c in cells:
        if m.name == "stiffness" and c["method"] == "pbd" and c["h"] is not None:
            out[is_sound(c)].append(value * c["h"])
    return out


def _short_answer(cells, holds) -> str:
    sound = sum(is_sound(c) for _, _, c in cells)
    limit = format_number(max(_sound_under_pbd(cells)[True], default=np.nan), 3)
    own = [h for h in holds if h["method"] == "pbd" and "sunk" in h]
    still = sum(h["jitter"] <= REST for h in own)
    return (
        f"{sound} of {len(cells)} pairs of scene and step end well, under PBD up to h K = {limit} "
        f"(step times stiffness); {still} of {len(own)} columns held by PBD come to rest."
    )


def _answer(cells, holds) -> str:
    sound = sum(is_sound(c) for _, _, c in cells)
    named = Counter(c["status"] for _, _, c in cells if not is_sound(c))
    words = ", ".join(f"{count} {status}" for status, count in named.most_common())
    by_hk = _sound_under_pbd(cells)
    pbd = [h for h in holds if h["method"] == "pbd" and "sunk" in h]
    still = [h for h in pbd if h["jitter"] <= REST]
    return (
        f"{sound} of {len(cells)} cells end well, the others are named ({words or 'none'}); PBD is "
        f"sound up to h K = {format_number(max(by_hk[True], default=np.nan), 3)} and flagged from "
        f"{format_number(min(by_hk[False], default=np.nan), 3)} on; of {len(pbd)} stacks held by "
        f"PBD {len(still)} have come to rest (no disc moves by more than {REST:g} in a step), one "
        f"has sunk by {format_number(max(h['sunk'] for h in pbd), 3)} radii, and no disc moved "
        f"sideways by more than {format_number(max(h['sideways'] for h in pbd), 2)}"
    )


def _piles_answer(piles: list[dict], ladder: list[dict]) -> str:
    """Say which piles PBD keeps in their rows, and with which steps it keeps one."""
    heaps = [h for h in piles if h["method"] == "pbd" and "sunk" in h]
    fallen = ", ".join(str(h["n"]) for h in heaps if h["toppled"])
    resting = sum(h["jitter"] <= REST and not h["toppled"] for h in heaps)
    own = [h for h in ladder if h["method"] == "pbd" and "sunk" in h]
    topples = ", ".join(format_number(h["h"], 3) for h in own if h["toppled"])
    keeps = ", ".join(format_number(h["h"], 3) for h in own if not h["toppled"])
    return (
        f"of {len(heaps)} piles held by PBD {resting} have come to rest in their rows, discs "
        f"topple in {f'those of {fallen} discs' if fallen else 'none'}; a pile of "
        f"{ladder[0]['n']} discs topples with h = {topples or 'none'} and keeps its places with "
        f"h = {keeps or 'none'}"
    )


def _evidence(cells, holds) -> tuple[str, ...]:
    by_method: dict[str, list[bool]] = {}
    for _, _, c in cells:
        by_method.setdefault(c["method"], []).append(is_sound(c))
    shares = "; ".join(f"{m} {sum(v)} of {len(v)}" for m, v in sorted(by_method.items()))
    jitter = max((h for h in holds if "jitter" in h), key=lambda h: h["jitter"])
    rise = max(h["rise"] for h in holds if "rise" in h)
    deepest = max((h for h in holds if "sunk" in h and is_sound(h)), key=lambda h: h["sunk"])
    silent = [
        (c["share"], f"{c['method']} on {m.name} {value:g}", c)
        for m, value, c in cells
        if is_sound(c) and c["share"] is not None and c["share"] > SILENT
    ]
    worst = max(silent, key=lambda s: s[0], default=None)
    warning = "none"
    if worst is not None:
        share, where, _ = worst
        warning = f"{len(silent)} cells, the worst {where} ({100.0 * share:.0f} %)"
    return (
        f"A status ok is no promise of accuracy: errors above {100 * SILENT:.0f} % of the motion "
        f"without a warning in {warning}.",
        f"Cells that end well, by method: {shares}.",
        f"Largest displacement in one of the last steps of a held stack: "
        f"{format_number(jitter['jitter'], 2)} radii ({jitter['method']}, n = {jitter['n']}, "
        f"{jitter['steps']} steps); largest rise of the energy between samples: "
        f"{format_number(rise, 2)}. Sunk the most under a status of a sound run: "
        f"{format_number(deepest['sunk'], 3)} radii ({deepest['method']}, n = {deepest['n']}).",
        "A column sinks under PBD until its floor carries the whole load, which takes a number of "
        "steps that grows like n^2 (study `multipliers`): taller stacks are still sinking here.",
    )


def _sweeps_evidence(cells) -> tuple[str, ...]:
    """Say what sweeps do at the longest step, one sentence for each method of the map."""
    out = []
    for m in (m for m in MAPS if m.options):
        for spec in m.options:
            errors = "; ".join(
                f"{value:g}: {_words(c)}"
                for own, value, c in cells
                if own.name == m.name
                and c["method"] == spec.format(value)
                and c["column"] == f"/{DIVISORS[0]}"
            )
            out.append(
                f"State error of {spec.format(m.small[0])} on {m.template} at the longest step, "
                f"by {m.difficulty}: {errors}."
            )
    return tuple(out)


def _words(cell: dict) -> str:
    shown = show(cell)
    return shown if isinstance(shown, str) else format_number(shown, 3)


def _piles_evidence(piles: list[dict]) -> tuple[str, ...]:
    ended = [h for h in piles if "sunk" in h]
    by_method = {}
    for h in (h for h in piles if h["steps"]):
        by_method.setdefault(h["method"], []).append(h)
    kept = "; ".join(
        f"{m} {sum('toppled' in h and not h['toppled'] for h in own)} of {len(own)}"
        for m, own in by_method.items()
    )
    silent = [h for h in ended if h["toppled"] and is_sound(h)]
    sunk = max((h for h in ended if not h["toppled"]), key=lambda h: h["sunk"], default=None)
    lines = [
        f"Piles whose discs all keep their places, by method: {kept}; discs topple under a status "
        f"of a sound run in {len(silent)} of {sum(map(len, by_method.values()))}."
    ]
    if sunk is not None:
        lines.append(
            f"Largest displacement in a pile that keeps its places: "
            f"{format_number(sunk['sunk'], 3)} radii ({sunk['method']}, n = {sunk['n']}), "
            f"{format_number(sunk['jitter'], 2)} in one of its last steps."
        )
    return tuple(lines)


def _ladder_evidence(ladder: list[dict]) -> tuple[str, ...]:
    """Say with which steps a pile keeps its places, one sentence for each method."""
    lines = []
    for method in dict.fromkeys(h["method"] for h in ladder):
        own = [h for h in ladder if h["method"] == method and "sunk" in h]
        shown = "; ".join(
            f"{format_number(h['h'], 3)}: {h['toppled']} topple, sunk by "
            f"{format_number(h['sunk'], 3)}"
            for h in own
        )
        lines.append(f"A pile of {ladder[0]['n']} discs under {method}, by h: {shown}.")
    return tuple(lines)


def _figures(maps, holds, piles, ladder) -> tuple[EvidenceFigure, ...]:
    panels = []
    for m in MAPS:
        curves = [
            Curve(name.format(value), *_curve(cells, name.format(value).partition(" ")[0]))
            for name in m.options or ("pbd {:g}", "catching_up {:g}")
            for value, cells in maps[m.name].items()
        ]
        panels.append(Panel(f"{m.difficulty}", tuple(curves), "h", "largest state error"))
    for title, held, x, label in (
        ("held stacks", holds, "n", "discs"),
        ("held piles", piles, "n", "discs"),
        (f"pile of {ladder[0]['n']} discs", ladder, "h", "h"),
    ):
        curves = []
        for method in dict.fromkeys(h["method"] for h in held):
            own = [h for h in held if h["method"] == method and "sunk" in h]
            curves.append(Curve(method, [h[x] for h in own], [h["sunk"] for h in own]))
        panels.append(Panel(title, tuple(curves), label, "sunk, in radii"))
    return (
        EvidenceFigure(
            "maps",
            "State error over the step by difficulty (runs that ended well); last row: how far "
            "stacks and piles have sunk at the end.",
            draw_panels(panels, columns=3),
        ),
    )


def _curve(cells: list[dict], method: str) -> tuple[list, list]:
    own = [c for c in cells if c["method"] == method and c["h"] is not None]
    used = [c for c in own if is_sound(c)]
    return [c["h"] for c in used], [np.nan if c["error"] is None else c["error"] for c in used]
