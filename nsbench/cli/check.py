"""`nsbench check`: does a case or a solver keep the contract, and compute what it says?

Each violation is a sentence. What is checked of a case: nsbench.cli.file_checks.case_checks, of a
method: nsbench.cli.file_checks.solver_checks.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from nsbench import solvers
from nsbench.case import case_names, get_case, load_case, load_module, parse_spec
from nsbench.case.selection import split_path, suite_parameters
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.cli.file_checks.case_checks import check_case, check_repeatable
from nsbench.cli.file_checks.solver_checks import check_solver
from nsbench.input_errors import describe

__all__ = ["check_case", "check_file", "check_name", "check_solver", "command"]

Say = Callable[[str], None]


def command(args: argparse.Namespace, say: Say) -> int:
    """Check files, or registered cases or solvers, and print each violation; 3 if there are any.

    Raises FileNotFoundError or LookupError if there is none of a name.
    """
    is_fine = True
    for name in args.files:
        violations = check_name(name, say)
        for sentence in violations:
            say(f"  not met: {sentence}")
        count = f"{len(violations)} point{'s' * (len(violations) > 1)} to correct"
        say(f"{name}: {count if violations else 'fine'}")
        is_fine = is_fine and not violations
    return FINE if is_fine else FAILED


def check_name(name: str, say: Say) -> list[str]:
    """Check what the name stands for: a file, a case or method of it with parameters, else a
    registered solver, else a registered case."""
    path, parameters = split_path(name) or ("", {})
    if parameters:
        return check_file(Path(path), say, parameters)
    if Path(name).exists() or parse_spec(name)[0].endswith(".py"):
        return check_file(Path(name), say)
    base, _ = parse_spec(name)
    if base in solvers.all_names():
        return check_solver(name, say)
    if base in case_names():
        return check_case(get_case(name), say)
    return check_file(Path(name), say)


def check_file(path: Path, say: Say, parameters: dict | None = None) -> list[str]:
    """Check a case file or a solver file, or the case or method that it makes with parameters.

    Returns the violations as sentences.

    Whatever the file raises is a violation too, but for FileNotFoundError and KeyboardInterrupt.
    `say` describes what was checked.
    """
    try:
        return _check_module(path, say, parameters or {})
    except (FileNotFoundError, KeyboardInterrupt):
        raise
    except (Exception, SystemExit) as e:
        return [str(e) if isinstance(e, (LookupError, ValueError)) else describe(e, path.resolve())]


def _check_module(path: Path, say: Say, parameters: dict) -> list[str]:
    module = load_module(path)
    if hasattr(module, "SOLVER"):
        name = _registered_name(path) or solvers.load(path)
        text = {k: str(v).lower() if isinstance(v, bool) else v for k, v in parameters.items()}
        options = ",".join(f"{key}={value}" for key, value in text.items())
        return check_solver(f"{name}[{options}]" if options else name, say)
    if parameters:
        case = load_case(path, **parameters)
        return [*check_repeatable(case, load_case(path, **parameters)), *check_case(case, say)]
    if hasattr(module, "CASE") or hasattr(module, "make"):
        case = load_case(path)
        for named in suite_parameters(module, "full"):
            load_case(path, **named)  # raises for a set that the case does not take
        return [*check_repeatable(case, load_case(path)), *check_case(case, say)]
    return [f"{path} defines none of CASE, make, SOLVER"]


def _registered_name(path: Path) -> str:
    """Return the name of the registered method whose file this is; "" if it is none."""
    path = path.resolve()
    home = Path(solvers.__file__).resolve().parent
    name = path.parent.name if path.name == "method.py" else path.stem
    is_method = home in path.parents and name in solvers.all_names()
    return name if is_method or _is_loaded(path) else ""


def _is_loaded(path: Path) -> bool:
    """Has the file been registered by an earlier call?"""
    import sys

    name = path.stem
    if name not in solvers.all_names():
        return False
    module = sys.modules.get(type(solvers.get(name)).__module__)
    return Path(getattr(module, "__file__", "") or "").resolve() == path
