"""`nsbench gate`: compare results with a baseline, or bring the baseline up to date."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from pathlib import Path

from nsbench.case.selection import python_files, split_path
from nsbench.case.spec import parse_spec
from nsbench.cli.exit_codes import FINE, NOTHING_COMPARED


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Compare a folder of results with a baseline: 0 as before, 1 not, 4 too little compared."""
    from nsbench.gate import baseline
    from nsbench.gate.comparison import (
        compare,
        describe_changed_cases,
        exit_code,
        format_lines,
        format_summary,
    )
    from nsbench.gate.facts import facts
    from nsbench.gate.tolerances import format_tolerances, widest_by_method
    from nsbench.report.data import read
    from nsbench.results.consistency import check
    from nsbench.results.tables import FORMULA

    if args.baseline is None:
        raise ValueError("--baseline FILE is needed, or an entry `baseline` in nsbench.toml")
    if args.update and not args.reason.strip():
        raise ValueError(
            "--update needs --reason: a sentence that says why the numbers are others now"
        )
    if args.reason.strip().startswith(FORMULA):
        raise ValueError(
            f"--reason is {args.reason.strip()[:40]!r}; a spreadsheet would take it for a formula"
        )
    check(args.dir)
    study = read(args.dir)
    if why := _why_stale(study, args):
        say(f"{why}. `nsbench run` makes them anew")
        _append(args.summary, f"**Not compared.** {why}.\n")
        return NOTHING_COMPARED
    measured = facts(study)
    path = Path(args.baseline)
    if args.update:
        return _update_baseline(measured, path, args, say)
    lines = baseline.read(path)
    differences = compare(measured, lines)
    code = exit_code(differences)
    changed_cases = describe_changed_cases(measured, lines)
    for line in changed_cases:
        say(line)
    for line in format_tolerances(widest_by_method(measured, lines)):
        say(line)
    for line in format_lines(differences):
        say(line)
    _append(args.summary, format_summary(differences, code, changed_cases))
    return code


def _append(path: str | None, text: str) -> None:
    """Append a text to the file of the summary, if there is one."""
    if path:
        with open(path, "a", encoding="utf-8") as file:
            file.write(text)


def _why_stale(study, args) -> str:
    """Say which files of cases and methods have changed since the runs were made; "" for none."""
    changed = {
        "case file": _changed_since(study.cases, args.case_files),
        "file of the method": _changed_methods(study.solvers, args.solver_files),
    }
    told = [f"{', '.join(k)}: the {what} has changed" for what, k in changed.items() if k]
    since = f"since the runs in {args.dir} were made; nothing is compared"
    return f"{'; '.join(told)} {since}" if told else ""


def _changed_since(described: dict, names: list[str]) -> list[str]:
    """Return the keys of described cases whose files, of their name, are among `names` and have
    other contents now.

    No case is built: runs may have been made with more memory, or of files that are not here.
    """
    from nsbench.study.describe import digest_of

    files = {f.stem: str(f) for f in _existing_files(names)}
    pairs = [(key, files.get(parse_spec(key)[0])) for key in described]
    return [k for k, f in pairs if f and digest_of(k, f) != described[k].get("digest", "")]


def _changed_methods(described: dict, names: list[str]) -> list[str]:
    """Return the specs of described methods whose files, of their name, are among `names` and have
    other contents now. No method is loaded."""
    from nsbench.study.describe import digest_of_method

    files = {f.stem: digest_of_method(str(f)) for f in _existing_files(names)}
    known = {spec: one.get("source") for spec, one in described.items()}
    return [s for s, was in known.items() if was and files.get(parse_spec(s)[0], was) != was]


def _existing_files(names: list[str]) -> list[Path]:
    """Return the Python files that the names of cases mean; none for what is not here."""
    out = []
    for path, _ in filter(None, map(split_path, names)):
        with contextlib.suppress(FileNotFoundError):
            out += python_files(path)
    return out


def _update_baseline(measured, path: Path, args, say) -> int:
    """Write the lines that changed into the baseline and say which they are."""
    from nsbench.gate import baseline, spreads
    from nsbench.gate.update import updated
    from nsbench.results.atomic_write import write_atomically
    from nsbench.source_files.regular_files import exists

    old = baseline.read(path) if exists(path) else {}
    reason = args.reason.strip()
    lines, changes = updated(measured, old, spreads.read(args.dir, measured), reason)
    if changes or not exists(path):
        write_atomically(path, baseline.text(lines).encode())
    for change in changes:
        say(change)
    say(f"{path}: {len(lines)} lines, {len(changes)} changed")
    in_baseline = {f"{line.case} {line.solver}" for line in lines}
    not_measured = sorted(in_baseline - {f"{f.case} {f.solver}" for f in measured.values()})
    if not_measured:
        say(
            f"of {len(not_measured)} that these results do not hold, such as {not_measured[0]}, "
            "every line stays; a line that is to go is deleted by hand"
        )
    return FINE
