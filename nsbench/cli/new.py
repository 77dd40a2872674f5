"""`nsbench new`: write a commented file of a case or a method to start from.

The files lie in `templates` beside this module, as WHAT_KIND.txt; each passes `nsbench check`.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path

from nsbench.cli.exit_codes import FINE
from nsbench.input_errors import nearest

TEMPLATES = Path(__file__).with_name("templates")
CASES = {"contact": "tide", "switch": "slide_exit"}  # one that a method of each kind takes
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,79}")  # of a file that Python can import


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Write NAME.py here. Raises ValueError for a bad name, LookupError for an unknown kind,
    FileExistsError for a file that is there already.
    """
    name = args.name.removesuffix(".py")
    if not NAME.fullmatch(name):
        raise ValueError(f"name {args.name[:80]!r}: letters, digits and '_', at most 80")
    kinds = [p.stem.removeprefix(f"{args.what}_") for p in TEMPLATES.glob(f"{args.what}_*.txt")]
    if args.kind not in kinds:
        raise LookupError(f"no {args.what} of the kind {args.kind!r}; {nearest(args.kind, kinds)}")
    path = Path(f"{name}.py")
    text = (TEMPLATES / f"{args.what}_{args.kind}.txt").read_text(encoding="utf-8")
    with open(path, "x", encoding="utf-8") as file:
        file.write(text.replace("NAME", name))
    is_case = args.what == "case"
    run = f"{path}" if is_case else f"{CASES[args.kind]} --solvers {path} -s {name}"
    say(f"{path}: edit it, then `nsbench check {path}` and `nsbench run {run}`")
    return FINE
