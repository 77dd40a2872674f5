"""`nsbench reference`: build, verify or list stored reference solutions."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from nsbench import reference
from nsbench.case import Case, get_case
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.cli.option_values import get_case_that_fits
from nsbench.study.plan import suite_cases


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Apply the action to each case, with its result in a line; 3 if it failed for one of them."""
    folder = args.into or None
    action, options = {
        "build": (reference.build, {"kind": args.kind}),
        "verify": (reference.verify, {"certify": args.certify}),
        "list": (reference.load, {}),
    }[args.action]
    keys = [get_case_that_fits(k).key for k in args.cases] or [
        k for k in suite_cases("full") if _concerns(get_case(k), args.action, folder)
    ]
    failures = 0
    for key in keys:
        case = get_case(key)
        start = time.perf_counter()
        try:
            result = action(case, folder=folder, **options)
            took = f" ({time.perf_counter() - start:.1f} s)" if args.action != "list" else ""
            say(f"{key}: {result or 'has no stored reference'}{took}")
        except (ValueError, ArithmeticError) as e:
            failures += 1
            say(f"{key}: {e}")
    return FAILED if failures else FINE


def _concerns(case: Case, action: str, folder) -> bool:
    """Has the case a stored reference or, to build, does it need one?"""
    if reference.files_of(case, folder)[1].exists():
        return True
    return action == "build" and case.exact is None and case.unique
