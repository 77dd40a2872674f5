"""`nsbench.toml`: what a folder runs and is compared with, so that plain commands do it.

    cases = ["my_case.py", "discs[n=10]"]       # names, files with parameters, folders
    methods = ["pbd", "event_driven"]
    method_files = ["my_method.py"]
    suite = "standard"                          # of cases that list SUITES
    out = "results"
    references = "references"
    baseline = "baseline.csv"
    reach = 1e-4                                # carry ladders on to this state error

    [ladders]
    h = "1e-2..1e-4"                            # as on the command line, or a list of numbers

    [tolerances]
    rtol = 1e-6                                 # of `nsbench compare`

All entries are optional; options of the command line come first. Paths are relative to the folder.
"""

from __future__ import annotations

import argparse
import tomllib
from pathlib import Path

from nsbench.input_errors import nearest

NAME = "nsbench.toml"
MAX_BYTES = 1 << 20
# verbs that know the methods of files
USE_METHODS = ("run", "step", "gate", "calibrate", "show", "list_")
# entry: type, and the option that it stands for, by verb
ENTRIES = {
    "cases": (list, {"run": "cases", "gate": "case_files", "calibrate": "case_files"}),
    "methods": (list, {"run": "solver"}),
    "method_files": (list, dict.fromkeys(USE_METHODS, "solver_files")),
    "suite": (str, {"run": "suite"}),
    "out": (str, {"run": "out", "gate": "dir", "calibrate": "dir"}),
    "references": (str, {"run": "references", "calibrate": "references", "reference": "into"}),
    "baseline": (str, {"gate": "baseline"}),
    "reach": (float, {"run": "reach"}),
}
POSITIONAL = ("cases", "dir")
OPTION_NAMES = {"case_files": "cases", "solver_files": "solvers"}  # where they differ
LADDERS = ("h", "tol", "k")
TOLERANCES = ("rtol",)
# of options that neither the command line nor the file gives
DEFAULTS = {
    "run": {"suite": "standard", "out": "results"},
    "gate": {"dir": "results"},
    "calibrate": {"dir": "results"},
    "compare": {"rtol": 1e-6},
}


def apply_project_file(args: argparse.Namespace, folder: Path | None = None) -> None:
    """Fill the options that were not given: from the file of the folder, else with defaults.

    args.project_entries: the entries that were used; their options are added to args.argv, so that
    this repeats the runs elsewhere. folder: None: the current one. Raises ValueError or LookupError
    that names file and entry.
    """
    verb = args.verb_module
    path = (folder or Path()) / NAME
    found = _read(path) if path.is_file() else {}
    given = {option for option, value in vars(args).items() if value not in (None, [])}
    if {"tag", "case_files", "suite"} & given and "cases" not in given:
        found.pop("cases", None)  # other cases are asked for
    own_results = Path(found.get("out", DEFAULTS["gate"]["dir"]))
    if verb == "gate" and "dir" in given and Path(args.dir) != own_results:
        for name in ("cases", "method_files"):  # runs of another folder may be of other files
            found.pop(name, None)
    options = {name: _option(name, verb) for name in found}
    used = [name for name, option in options.items() if option and option not in given]
    for name in used:
        setattr(args, options[name], found[name])
    args.project_entries = used
    written = [word for name in used for word in _words(options[name], found[name])]
    args.argv = [*getattr(args, "argv", []), *written]
    for option, value in DEFAULTS.get(verb, {}).items():
        if getattr(args, option) is None:
            setattr(args, option, value)


def _words(option: str, value: object) -> list[str]:
    """Return an option with its value as it is written on the command line."""
    if option in POSITIONAL:
        return [str(v) for v in (value if isinstance(value, list) else [value])]
    flag = f"--{OPTION_NAMES.get(option, option)}"
    values = value if isinstance(value, list) else [value]
    return [word for v in values for word in (flag, str(v))]


def _option(name: str, verb: str) -> str:
    """Return the option of the verb that an entry stands for; "" if it stands for none."""
    if name in ENTRIES:
        return ENTRIES[name][1].get(verb, "")
    return name if verb == ("compare" if name in TOLERANCES else "run") else ""


def _read(path: Path) -> dict:
    """Read and check the entries; those of ladders and tolerances are returned by their names."""
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path} is longer than {MAX_BYTES} bytes")
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise ValueError(f"{path} cannot be read: {e}") from None
    out = {}
    for name, value in content.items():
        if name == "ladders":
            out |= {k: _ladder(path, k, v) for k, v in _table(path, name, value, LADDERS).items()}
        elif name == "tolerances":
            out |= _table(path, name, value, TOLERANCES)
        elif name not in ENTRIES:
            known = [*ENTRIES, "ladders", "tolerances"]
            raise LookupError(f"{path} has the entry {name!r}; {nearest(name, known)}")
        elif not isinstance(value, ENTRIES[name][0]):
            kinds = {list: "a list of texts", str: "a text", float: "a number such as 1e-4"}
            wanted = kinds[ENTRIES[name][0]]
            raise ValueError(f"{name} of {path} is {value!r:.60}; {wanted} is needed")
        elif isinstance(value, list) and not all(isinstance(v, str) for v in value):
            raise ValueError(f"{name} of {path} is {value!r:.60}; a list of texts is needed")
        else:
            out[name] = value
    return out


def _table(path: Path, name: str, value: object, known: tuple[str, ...]) -> dict:
    """Return a table of the file after a check of its keys."""
    if not isinstance(value, dict):
        raise ValueError(f"{name} of {path} is {value!r:.60}; a table [{name}] is needed")
    for key in value:
        if key not in known:
            raise LookupError(f"[{name}] of {path} has the entry {key!r}; {nearest(key, known)}")
    return value


def _ladder(path: Path, name: str, value: object) -> str:
    """Return accuracies as they are written on the command line."""
    values = value if isinstance(value, list) else [value]
    if not all(isinstance(v, (str, int, float)) for v in values):
        raise ValueError(f"{name} of {path} is {value!r:.60}; write '1e-2..1e-4' or [0.01, 0.001]")
    return ",".join(map(str, values))
