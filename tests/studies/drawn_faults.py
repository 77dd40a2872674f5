"""Faults drawn at random from the source: one of each kind in each place, by a seed.

    python tests/studies/drawn_faults.py [--seed N]

Kinds: a changed operator, a changed constant, a shifted index, a dropped line. Places: kernels,
measures, formatting. Every site of a kind in the files of a place is equally likely. Nothing is
known of what a drawn fault does: it may lie in code that a study never runs, or change no number.
Prints the faults of a seed.
"""

import argparse
import ast
import random
import re
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from copies import ROOT

SEED = 24
# what mutants are drawn from (mutants.py)
ROOMS = {
    "kernels": (
        "nsbench/solvers/**/kernels/*.py",
        "nsbench/dynamics/**/kernels/*.py",
        "nsbench/qp/kernels/*.py",
        "nsbench/linalg/*.py",
        "nsbench/lcp/*.py",
    ),
    "measure": ("nsbench/measure/**/*.py",),
    "gate": ("nsbench/gate/*.py",),
    "journal": (
        "nsbench/results/journal.py",
        "nsbench/results/row_reuse.py",
        "nsbench/results/packed_rows.py",
        "nsbench/results/run_key.py",
        "nsbench/results/tables.py",
        "nsbench/results/consistency.py",
    ),
}
# drawn, and without effect on any number: the next of its place and kind is drawn instead
WITHOUT_EFFECT = {
    "nsbench/report/summary.py: kept = last <= bound -> <": (
        "differs only where an error equals its claimed bound to the last bit"
    ),
    "nsbench/report/summary.py: or abs(value - claim) <= CLAIM_TOLERANCE -> <": (
        "differs only where an order is exactly a tolerance from its claim"
    ),
    "nsbench/gate/calibrate.py: THREADS = 2  # of the pass from the unchanged start -> 3": (
        "runs have the same bits with any number of threads"
    ),
    "nsbench/report/summary.py: or interval[0] <= claim <= interval[1] -> <": (
        "differs only where a claim is exactly an end of an interval"
    ),
    'nsbench/report/summary.py: if s.state.kind == "bound" and s.state.claim is not None: -> or': (
        "names methods in a sentence of the report; the gate holds whether a bound is kept"
    ),
    'nsbench/report/style.py: scale, unit = (1.0, "s") if value >= 1.0 else (1e-3, "ms") if value '
    '>= 1e-3 else (1e-6, "µs") -> 1.0099999999999999e-06': (
        "how seconds are written in a report; the gate compares none"
    ),
    "nsbench/report/summary.py: code = statuses.most_common(1)[0][0] -> 2": (
        "the first of the two commonest is the commonest"
    ),
    "nsbench/report/style.py: return text if len(text) <= limit "
    'else text[: limit - 1] + "…" -> <': (
        "cuts a sentence of exactly 600 characters; the gate holds numbers and statuses"
    ),
    'nsbench/measure/multiplier_times.py: return out | {"lam_own": out[OWN[traj.lam_time]], '
    '"lam_floor": 10.0 * floor} -> 10.1': (
        "moves the level below which an error is rounding by one per cent, and no error"
    ),
}
PLACES = {  # a pattern that begins with "!" takes files out again
    "kernels": (
        "nsbench/solvers/pbd/kernels/*.py",
        "nsbench/solvers/catching_up/kernels/*.py",
        "nsbench/solvers/euler/kernels/*.py",
        "nsbench/solvers/theta/kernels/*.py",
        "nsbench/solvers/event_driven/*/kernels/*.py",
        "nsbench/dynamics/*/kernels/*.py",
        "nsbench/qp/kernels/*.py",
        "nsbench/linalg/*.py",
        "nsbench/lcp/*.py",
    ),
    "measures": ("nsbench/measure/*.py", "nsbench/measure/orders/*.py"),
    "formatting": (
        "nsbench/gate/*.py",
        "!nsbench/gate/comparison_page.py",  # the page of `nsbench compare`: the gate writes none
        "nsbench/report/style.py",
        "nsbench/report/summary.py",
        "nsbench/results/tables.py",
    ),
}
SWAPPED = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
LARGER = 1.01  # times a constant, and what becomes of 0.0; whole numbers grow by one


@dataclass(frozen=True)
class Site:
    """A place in a source: the text from `start` to `end` becomes `other`."""

    start: int
    end: int
    other: str


class Sites(ast.NodeVisitor):
    """Sites of a source by kind; annotations, docstrings and defaults of options are left out."""

    def __init__(self, source: str):
        self.source = source
        self.lines = [0]
        for text in source.encode().splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(text))
        self.inside = 0
        self.found = {"operator": [], "constant": [], "index": [], "line": []}

    def span(self, node) -> tuple[int, int]:
        """Offsets of a node in the bytes of the source."""
        return (
            self.lines[node.lineno - 1] + node.col_offset,
            self.lines[node.end_lineno - 1] + node.end_col_offset,
        )

    def visit_FunctionDef(self, node):
        self.inside += 1
        for statement in node.body:
            self.visit(statement)
        self.inside -= 1

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_AnnAssign(self, node):
        if node.value is not None:
            self.visit(node.value)

    def between(self, left, right, operator):
        """Note the operator between two operands."""
        symbol, other = SWAPPED.get(type(operator), ("", ""))
        if not symbol:
            return
        start = self.span(left)[1]
        gap = self.source.encode()[start : self.span(right)[0]].decode()
        at = re.search(rf"(?<![<>=!]){re.escape(symbol)}(?![=*/])", gap)
        if at:
            self.found["operator"].append(Site(start + at.start(), start + at.end(), other))

    def visit_BinOp(self, node):
        operands = (node.left, node.right)
        if not any(isinstance(x, ast.Constant) and isinstance(x.value, str) for x in operands):
            self.between(node.left, node.right, node.op)
        self.generic_visit(node)

    def visit_Compare(self, node):
        operands = (node.left, *node.comparators)
        for k, operator in enumerate(node.ops):
            self.between(operands[k], operands[k + 1], operator)
        self.generic_visit(node)

    def visit_BoolOp(self, node):
        for k in range(len(node.values) - 1):
            self.between(node.values[k], node.values[k + 1], node.op)
        self.generic_visit(node)

    def visit_Constant(self, node):
        if isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
            whole = isinstance(node.value, int)
            other = repr(node.value + 1 if whole else node.value * LARGER or LARGER)
            self.found["constant"].append(Site(*self.span(node), other))

    def visit_Subscript(self, node):
        index = node.slice
        number = isinstance(index, ast.Constant) and isinstance(index.value, int)
        if self.inside and (number or isinstance(index, (ast.Name, ast.BinOp))):
            start, end = self.span(index)
            text = self.source.encode()[start:end].decode()
            self.found["index"].append(Site(start, end, f"{text} + 1"))
        self.visit(node.value)
        if not number:
            self.visit(index)

    def visit_JoinedStr(self, node):
        """Positions within formatted strings are no offsets of the source before Python 3.12."""

    def generic_visit(self, node):
        words = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        statement = isinstance(node, (ast.Expr, ast.Assign, ast.AugAssign))
        if self.inside and statement and not words:
            self.found["line"].append(Site(*self.span(node), "pass"))
        super().generic_visit(node)


def sites_of(path: Path) -> dict[str, list[Site]]:
    """Sites of a file by kind."""
    source = path.read_text(encoding="utf-8")
    visitor = Sites(source)
    visitor.visit(ast.parse(source))
    return visitor.found


def files_of(patterns, root: Path = ROOT) -> list[Path]:
    """Files that match patterns, without those that match a pattern after a "!"."""
    out: set[Path] = set()
    for pattern in patterns:
        name = pattern.removeprefix("!")
        out = out | set(root.glob(name)) if name == pattern else out - set(root.glob(name))
    return sorted(out)


def drawn(seed: int, root: Path = ROOT) -> dict[str, tuple[str, str, str]]:
    """Draw one fault of every kind in every place, but for those of WITHOUT_EFFECT.

    Returns (file, its text, its other text) by a name with place, kind, file, line, and what was
    changed.
    """
    rng = random.Random(seed)
    out = {}
    for place, patterns in PLACES.items():
        files = files_of(patterns, root)
        found = {p: sites_of(p) for p in files}
        for kind in ("operator", "constant", "index", "line"):
            sites = [(p, s) for p in files for s in found[p][kind]]
            path, site = rng.choice(sites)
            again = random.Random(f"{seed} {place} {kind}")
            while named(path, site, root) in WITHOUT_EFFECT:
                path, site = again.choice(sites)
            title, fault = changed(path, site, root)
            out[f"{place}, {kind}: {title}"] = fault
    return out


def changed(path: Path, site: Site, root: Path = ROOT) -> tuple[str, tuple[str, str, str]]:
    """Return a title with file, line and what is changed at a site; and the replacement."""
    text = path.read_text(encoding="utf-8")
    raw = text.encode()
    other = (raw[: site.start] + site.other.encode() + raw[site.end :]).decode()
    name = path.relative_to(root).as_posix()
    line = raw[: site.start].count(b"\n") + 1
    was = " ".join(raw[site.start : site.end].decode().split())
    return f"{name}:{line}: {was[:60]} -> {site.other}", (name, text, other)


def named(path: Path, site: Site, root: Path = ROOT) -> str:
    """Return file, line of text and change of a site: what stays when other lines move."""
    raw = path.read_bytes()
    number = raw[: site.start].count(b"\n")
    line = raw.splitlines()[number].decode().strip()
    return f"{path.relative_to(root).as_posix()}: {line} -> {site.other}"


def mutants(count: int, seed: int) -> list[tuple]:
    """Draw (room, path, site) without repetition: rooms in turn, kinds as likely as each other."""
    rng = random.Random(seed)
    drawn = {}
    for room, patterns in ROOMS.items():
        files = sorted({p for pattern in patterns for p in ROOT.glob(pattern)})
        by_kind: dict[str, list] = {}
        for path in files:
            for kind, sites in sites_of(path).items():
                by_kind.setdefault(kind, []).extend((room, path, s) for s in sites)
        for sites in by_kind.values():
            rng.shuffle(sites)
        drawn[room] = in_turn(by_kind[k] for k in sorted(by_kind))
    return in_turn(drawn.values())[:count]


def in_turn(lists) -> list:
    """Merge lists: the first of each, the second of each, and so on to the end of the longest."""
    turns = zip_longest(*lists)
    return [one for turn in turns for one in turn if one is not None]


def main() -> None:
    p = argparse.ArgumentParser()
    p.add_argument("--seed", type=int, default=SEED)
    for title in drawn(p.parse_args().seed):
        print(title)


if __name__ == "__main__":
    main()
