"""The baseline: a CSV file with one reviewable number per line."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from decimal import ROUND_DOWN, Context
from pathlib import Path

from nsbench.gate.facts import KINDS, Fact
from nsbench.source_files.regular_files import exists, read_text

COLUMNS = (
    "case",
    "solver",
    "parameters",
    "metric",
    "kind",
    "value",
    "rtol",
    "atol",
    "unit",
    "config",
    "why",
)
ENOUGH = 10 << 20  # bytes: a larger file is no baseline
LEAST = 1e-6  # relative tolerance of a number that does not spread: other libraries round otherwise
WIDER = 10.0  # tolerance over spread: three perturbed runs see a part of what rounding can do
MOST = 10.0  # times the claim of a method: a tolerance that lets such an error pass holds nothing
TWO_DIGITS = Context(prec=2, rounding=ROUND_DOWN)  # of a tolerance: it stays below its limit
GATEABLE = 1e-2  # spread beyond which a number says nothing
# value of a word that is not held; a number that is not held has the relative tolerance inf
ANY = "*"


@dataclass(frozen=True)
class Line:
    """A fact with its tolerances |value - new| <= atol + rtol |value| and the reason why it stands
    as it does."""

    case: str
    solver: str
    parameters: str
    metric: str
    kind: str
    value: float | str
    rtol: float
    atol: float
    unit: str
    config: str
    why: str

    key = Fact.key

    @property
    def held(self) -> bool:
        """False: it spreads too far, and is only reported."""
        return math.isfinite(self.rtol) and math.isfinite(self.atol) and self.value != ANY


def read(path) -> dict[tuple, Line]:
    """Read the lines of a baseline, by key.

    FileNotFoundError without the file. ValueError names the file, the line and the value that
    cannot be used; NaN is refused.
    """
    path = Path(path)
    if not exists(path):
        raise FileNotFoundError(f"no baseline {path}")
    text = read_text(path, ENOUGH)
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    out: dict[tuple, Line] = {}
    try:
        head = next(rows, None)
        if head is None or tuple(head) != COLUMNS:
            raise ValueError(f"{path}: the first line is {head}; {','.join(COLUMNS)} is needed")
        for row in rows:
            line = _line(row, f"{path}, line {rows.line_num}")
            if line.key in out:
                raise ValueError(
                    f"{path}, line {rows.line_num}: {' '.join(line.key)} stands there twice"
                )
            out[line.key] = line
    except csv.Error as e:
        raise ValueError(f"{path}, line {rows.line_num}: {e}") from None
    return out


def _line(row: list[str], where: str) -> Line:
    if len(row) != len(COLUMNS):
        raise ValueError(f"{where}: {len(row)} fields; {len(COLUMNS)} are needed")
    field = dict(zip(COLUMNS, row, strict=True))
    if field["kind"] not in KINDS:
        raise ValueError(f"{where}: kind is {field['kind']!r}; one of {', '.join(KINDS)}")
    value = field["value"] if field["kind"] == "class" else _number(field["value"], "value", where)
    rtol = math.inf if field["rtol"] == "inf" else _number(field["rtol"], "rtol", where)
    atol = math.inf if field["atol"] == "inf" else _number(field["atol"], "atol", where)
    if rtol < 0 or atol < 0:
        raise ValueError(
            f"{where}: tolerances are {rtol:g} and {atol:g}; they must not be negative"
        )
    return Line(
        *(field[n] for n in COLUMNS[:5]),
        value,
        rtol,
        atol,
        field["unit"],
        field["config"],
        field["why"],
    )


def _number(text: str, name: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{where}: {name} is {text!r}; a finite number is needed")
    return value


def text(lines) -> str:
    """Write lines as the text of a baseline; numbers as repr gives them: nothing is lost."""
    out = io.StringIO()
    w = csv.writer(out, lineterminator="\n")
    w.writerow(COLUMNS)
    for x in lines:
        w.writerow(
            [
                x.case,
                x.solver,
                x.parameters,
                x.metric,
                x.kind,
                x.value if isinstance(x.value, str) else repr(x.value),
                f"{x.rtol:.2g}",
                f"{x.atol:.2g}",
                x.unit,
                x.config,
                x.why,
            ]
        )
    return out.getvalue()


def line(fact: Fact, spread: float, why: str) -> Line:
    """Make the line of a fact whose runs from starts 1e-12 apart differ by `spread` (inf: one of
    them failed or said another word).

    near: ten times the spread, relative to the value. max: up to ten times the value or the spread,
    at least up to the floor: what lies below a floor is held below it. min: as far below. count:
    exact where nothing was seen to change. What spreads by more than a hundredth is not held, nor
    is what could grow to more than ten times the claim of its method: it is only reported, and it
    must still be there and be finite.
    """
    if fact.kind == "class":
        return _made(fact, ANY if spread else fact.value, 0.0, 0.0, why)
    relative = spread / abs(fact.value) if fact.value else math.inf if spread else 0.0
    if fact.kind == "count":
        held = relative <= GATEABLE
        return _made(fact, fact.value, WIDER * relative if held else math.inf, 0.0, why)
    if fact.kind == "near":
        made = _made(fact, fact.value, max(WIDER * relative, LEAST), fact.floor, why)
    else:
        made = _made(fact, fact.value, 0.0, _room_above(fact, spread), why)
    if relative > GATEABLE and fact.kind == "near" or is_blind(made, fact):
        return _made(fact, fact.value, math.inf, 0.0, why)
    return made


def _room_above(fact: Fact, spread: float) -> float:
    """How far beyond its value a number may lie that is held on one side, in two digits."""
    size = abs(fact.value)
    limit = max(WIDER * max(size, spread), fact.floor)
    return float(TWO_DIGITS.create_decimal_from_float(max(limit - size, 0.0)))


def times_claim(line: Line, fact: Fact) -> float:
    """Return what a line lets pass over the claim of its fact; 0 where it holds no number.

    near: the tolerance over the claim, or over the value where that is larger (an error that breaks
    the claim is held near itself). max, min: the largest error that passes over the claim.
    """
    if not line.held or line.kind not in ("near", "max", "min") or isinstance(line.value, str):
        return 0.0
    size = abs(line.value)
    room = line.atol + line.rtol * size
    claim = fact.claim or max(size, fact.floor)
    passes = room
    if line.kind == "near":
        claim = max(claim, size)
    else:
        passes = size + room
    if not passes:
        return 0.0
    return passes / claim if claim else math.inf


def is_blind(line: Line, fact: Fact) -> bool:
    """Does a line let an error pass that is more than ten times the claim of its method?"""
    return times_claim(line, fact) > MOST * (1 + 1e-9)  # a quotient is rounded


def _made(fact: Fact, value, rtol: float, atol: float, why: str) -> Line:
    return Line(
        fact.case,
        fact.solver,
        fact.parameters,
        fact.metric,
        fact.kind,
        value,
        float(f"{rtol:.2g}"),
        float(f"{atol:.2g}"),
        fact.unit,
        fact.config,
        why,
    )


def same(a: Line, b: Line) -> bool:
    """Are two lines equal but for their reasons?"""
    return replace(a, why="") == replace(b, why="")
