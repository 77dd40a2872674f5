"""What the bench must survive, in one list; each entry has at least one test that is marked with
its name.

    @pytest.mark.survives("nan at the start")

An outcome is E, an error before anything runs (exit code 2, with the offending value), R, a row
with a status and a sentence while the other runs go on, or a word of its own.
`tests/studies/survived.py` runs the marked tests and prints the table;
`tests/robustness/test_survived.py` fails where an entry has no test.
"""

import ast
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parents[1]


@dataclass(frozen=True)
class Entry:
    """name: as in the mark; room: numerics, harness or promises; what: the sentence of the table;
    outcome: what is expected."""

    name: str
    room: str
    what: str
    outcome: str


def _room(room, *lines):
    return [Entry(name, room, what, outcome) for name, what, outcome in lines]


ENTRIES = [
    *_room(
        "numerics",
        (
            "nan at the start",
            "The drift is no number at the start time",
            "R nan, no loop without end",
        ),
        ("nan later", "The drift stops being a number on the way", "R nan, with the time"),
        ("infinite drift", "The drift is infinite", "R"),
        ("start not finite", "NaN or infinity among the start's coordinates", "E"),
        ("blow-up", "The solution leaves every bound in finite time", "R diverged"),
        ("shape of the drift", "The drift returns another shape than the state's", "E"),
        ("type of the drift", "The drift returns integers or complex numbers", "E"),
        ("in place", "The drift writes into the state it is given", "E"),
        (
            "coincident centres",
            "Centres of two discs coincide: no gradient",
            "R degenerate; they part along the first axis",
        ),
        ("almost coincident", "Centres 1e-300 apart", "R degenerate or ok; never NaN under ok"),
        (
            "infeasible start",
            "A start outside the constraints",
            "as the case says: error, project or keep",
        ),
        ("dependent constraints", "The same constraint twice, and multiples of it", "one reaction"),
        ("empty set", "No state meets all constraints", "R infeasible"),
        ("short chain", "A chain whose links cannot span its anchors", "R"),
        ("no gradient", "A smooth constraint whose gradient vanishes on its own boundary", "R"),
        ("step no number", "A step of 0, below 0, NaN or infinite", "E"),
        (
            "step beyond the end",
            "A step longer than the whole run",
            "one step, and the row says which",
        ),
        (
            "end between steps",
            "The end is no multiple of the step",
            "a shorter last step; orders in the steps taken",
        ),
        ("no time", "A run that ends where it starts", "E"),
        ("time backwards", "An end before the start", "E"),
        ("step below rounding", "A step that vanishes when added to the time", "E"),
        ("stiffness no number", "A penalty of 0 or below, NaN or infinite", "E"),
        ("stiffness 1e16", "A penalty of 1e16", "R"),
        (
            "stiff and explicit",
            "A step beyond the stability limit of an explicit method",
            "R diverged",
        ),
        ("graze", "A contact that touches in one point", "no event missed, none invented"),
        ("many impacts", "Many contacts that close in the same instant", "ok"),
        ("zeno", "Events that accumulate", "R chatter, with the time"),
        ("event at a sample", "An event exactly at a sample, at the start, at the end", "ok"),
        ("two events in a step", "Two events within one step", "ok"),
        (
            "repulsive",
            "A surface that both fields leave: many solutions",
            "R, or measured by the distance to all solutions",
        ),
        ("tangential", "Fields that are tangential to their surface", "ok"),
        ("iteration limit", "A QP that reaches its iteration limit", "counted"),
        ("false solution", "A QP that is called solved and is not", "R unverified"),
        (
            "float32",
            "Single precision in the data, the drift, or what a solver returns",
            "E, or R error",
        ),
        ("far away", "Coordinates of 1e8", "ok, to the rounding of such coordinates"),
        ("radius no length", "A radius of 0, below 0, NaN", "E"),
        ("few particles", "No particle, one, two", "ok or R"),
        (
            "giant",
            "More particles than memory can hold",
            "E, with memory and pairs that were predicted",
        ),
        (
            "error zero",
            "An error of exactly 0 in fits and on logarithmic axes",
            "no order; drawn at the edge",
        ),
        ("two steps", "Fewer than three steps", "no order"),
        ("errors that grow", "Errors that do not fall with the step", "no order claimed"),
        (
            "coarse reference",
            "A reference worse than the method",
            "R below_reference, no number shown",
        ),
    ),
    *_room(
        "harness",
        (
            "hang",
            "A solver that never returns from C code",
            "R timeout, killed by the parent; others go on",
        ),
        (
            "death",
            "A solver that ends its process, or whose process is killed",
            "R crashed; others go on",
        ),
        ("memory", "A run that asks for more memory than there is", "R oom; others go on"),
        ("ctrl-c", "Ctrl-C, once and twice", "exit 130, the journal is kept"),
        (
            "kill",
            "A suite that is killed at any moment",
            "loses at most the runs in flight; the next call goes on",
        ),
        ("disk full", "No room left on the disk", "exit 5, no half file; the next call goes on"),
        (
            "a repetition",
            "A run that goes well once and fails when it is repeated to be timed",
            "R; others keep their times",
        ),
        ("output of a run", "What a solver prints", "kept with its run"),
        (
            "half a character",
            "Text in a row that UTF-8 cannot spell",
            "told by its numbers; tables and report as ever",
        ),
        (
            "half a line",
            "A journal that ends within a line, or holds lines that are none",
            "they are dropped",
        ),
        ("read-only", "A results folder that cannot be written to", "E"),
        ("output is a file", "The output is a file, or a link that leads nowhere", "E"),
        ("one folder", "A second run in the folder of one that is going on", "refused, exit 5"),
        (
            "spoilt results",
            "Tables and notes of results that are cut short or damaged",
            "E, naming the file",
        ),
        (
            "older tables",
            "Tables from before a run that did not end, or of another journal",
            "E, naming the folder",
        ),
        (
            "spoilt reference",
            "A stored reference that is cut short or damaged",
            "E, naming the file",
        ),
        ("spoilt baseline", "A baseline that is cut short or damaged", "E, naming the file"),
        (
            "foreign reference",
            "A stored reference of another checksum or version of its case",
            "E, naming the file",
        ),
        (
            "stale",
            "Another package, case, solver, option or library than the one a row was made with",
            "runs again",
        ),
        ("not picklable", "Cases and solvers that cannot be pickled", "run: they travel by name"),
        (
            "broken plugin",
            "A plugin that cannot be imported, or is none",
            "others run, list says why",
        ),
        (
            "names",
            "Names with markup, formulas, escapes, paths, line breaks, 300 characters",
            "E, or text and nothing else",
        ),
        (
            "damaged cache",
            "Stored machine code that is cut short, damaged or cannot be read",
            "compiled again",
        ),
        (
            "no plain file",
            "Links out of a results folder, devices and FIFOs in the place of its files",
            "E, naming the file",
        ),
        ("no pickle", "A pickle where data is expected", "never read"),
        (
            "same name",
            "Two cases or two solvers of one name, or of names equal but for case",
            "E, with both files",
        ),
        ("nearest name", "Unknown names, parameters and options", "E, with the nearest one"),
        ("nothing matches", "A filter that leaves nothing", "E"),
        (
            "another baseline",
            "A baseline with other lines, NaN, or of another configuration",
            "exit 4 or E; NaN never passes",
        ),
        (
            "locale",
            "Decimal commas, LANG=C, line ends of Windows, names that are not ASCII",
            "the same results",
        ),
        ("terminal", "No terminal, NO_COLOR, 20 columns, no display", "plain lines that fit"),
        ("threads", "Several workers on few cores", "one thread each"),
        (
            "global state",
            "A plugin that changes random state, error state or settings of jax",
            "the next run does not see it",
        ),
        ("warnings", "Warnings of a run", "counted in its row"),
        ("all fail", "No run of a study gives a number", "exit 3, and a report"),
        ("another schema", "Results of another version's schema", "E, naming the file"),
        ("million rows", "A million rows", "a report in bounded time and size"),
        ("oversized", "Files far larger than such files are", "E, naming the file"),
    ),
    *_room(
        "promises",
        ("closed list", "Every row has a status of a closed list", "kept"),
        (
            "ok is finite",
            "A row that says ok is finite and reached its end time",
            "kept, whatever the solver says",
        ),
        ("another start", "A run that says ok and begins elsewhere than its case", "R error"),
        ("another step", "A run that says ok and tells of steps it was not asked for", "R error"),
        (
            "own residuals",
            "Residuals of a row are computed by the bench",
            "kept, whatever the solver says",
        ),
        (
            "same bytes",
            "The same run on the same machine gives the same numbers",
            "kept, byte for byte",
        ),
        ("silent wrong", "Runs that say ok and are further off than their method claims", "none"),
    ),
]


def marked() -> dict[str, list[str]]:
    """Tests by the name of the entry that they are marked with: "test_file.py::test_name"."""
    out: dict[str, list[str]] = {}
    for path in sorted(HERE.rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            for call in (c for d in node.decorator_list for c in ast.walk(d)):
                if isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "survives":
                    for a in call.args:
                        out.setdefault(a.value, []).append(f"{path.name}::{node.name}")
    return out
