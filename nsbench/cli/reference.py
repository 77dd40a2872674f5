"""`nsbench reference`: build, verify or list stored reference solutions."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from nsbench import reference
from nsbench.case import Case, get_case
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.cli.option_values import find_cases
from nsbench.study.plan import suite_cases

OF_FILES = "results/references"  # where `nsbench run` stores those of case files


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Apply the action to each case, with its result in a line; 3 if it failed for one of them."""
    folder = args.into or None
    action, options = {
        "build": (reference.build, {"kind": args.kind}),
        "verify": (reference.verify, {"certify": args.certify}),
        "list": (reference.load, {}),
    }[args.action]
    failures = 0
    for case, file in _select_cases(args, folder):
        start = time.perf_counter()
        where = folder or (OF_FILES if file else None)
        try:
            result = action(case, folder=where, **options)
            took = f" ({time.perf_counter() - start:.1f} s)" if args.action != "list" else ""
            none = f"has no stored reference in {where or 'the package'} (another folder: --into)"
            say(f"{case.key}: {result or none}{took}")
        except (ValueError, ArithmeticError) as e:
            failures += 1
            say(f"{case.key}: {e}")
    return FAILED if failures else FINE


def _select_cases(args: argparse.Namespace, folder) -> list[tuple[Case, str]]:
    """Cases of the arguments with their files; without any, the registered ones concerned."""
    if args.cases:
        return find_cases(args.cases)
    registered = map(get_case, suite_cases("full"))
    return [(case, "") for case in registered if _concerns(case, args.action, folder)]


def _concerns(case: Case, action: str, folder) -> bool:
    """Has the case a stored reference or, to build, does it need one?"""
    if reference.files_of(case, folder)[1].exists():
        return True
    return action == "build" and case.exact is None and case.unique
