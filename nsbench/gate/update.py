"""Update a baseline: lines whose facts changed are written anew, each with the reason given."""

from __future__ import annotations

from nsbench.gate.baseline import Line, is_blind, line, same
from nsbench.gate.comparison import compare, differing_parts, format_value
from nsbench.gate.facts import Fact


def updated(
    found: dict[tuple, Fact], old: dict[tuple, Line], spread: dict[tuple, float], reason: str
):
    """Bring the baseline `old` up to date with the facts `found`, giving `reason` for what changes.

    spread: of every fact that changed, from calibration. Returns (lines, changes): the new baseline
    in the order of `found`, and a sentence for every line that is not as before.

    A line that passes stays as it is, to the byte: rounding on another machine is no change; unless
    it lets more than ten times the claim of its method pass, which holds nothing. So do, at the
    end, the lines of what these results do not hold at all: a part of a study takes nothing
    from the rest. ValueError for a fact whose spread is not known.
    """
    passed = {
        f.key
        for f in compare(found, old)
        if f.outcome in ("pass", "not held") and not is_blind(old[f.key], found[f.key])
    }
    lines = []
    changes = []
    for key, fact in found.items():
        before = old.get(key)
        if key in passed:
            lines.append(before)
            continue
        name = " ".join(key)
        if key not in spread:
            raise ValueError(f"how far {name} spreads is not known: run nsbench calibrate again")
        after = line(fact, spread[key], reason)
        lines.append(after)
        if before is None:
            changes.append(f"{name}: new, {format_value(after.value)}")
        elif not same(before, after):
            other = differing_parts(before.config, after.config)
            changes.append(
                f"{name}: {format_value(before.value)} -> {format_value(after.value)}"
                + (f", {' and '.join(other)} of another version" if other else "")
                + (f", {_room(before)} -> {_room(after)}" if is_blind(before, fact) else "")
            )
    run = {key[:2] for key in found}
    lines += [x for key, x in old.items() if key[:2] not in run]
    gone = [key for key in old if key not in found and key[:2] in run]
    return lines, changes + [
        f"{' '.join(key)}: {format_value(old[key].value)} -> no line: not given any more"
        for key in gone
    ]


def _room(line: Line) -> str:
    """The tolerance of a line in words."""
    return f"within {line.atol + line.rtol * abs(line.value):.2g}" if line.held else "not held"
