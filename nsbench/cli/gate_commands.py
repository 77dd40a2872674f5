"""What the commands do that hold results against others; like nsbench.cli.commands."""

from __future__ import annotations

from pathlib import Path

from nsbench.cli.commands import FINE, workers

NOTHING = 4


def gate(args, say) -> int:
    """nsbench gate"""
    from nsbench.gate import baseline, messages
    from nsbench.gate.comparison import compare, exit_code
    from nsbench.gate.facts import facts
    from nsbench.report.data import read
    from nsbench.results.consistency import check
    from nsbench.results.tables import FORMULA

    if args.update and not args.reason.strip():
        raise ValueError(
            "--update needs --reason: a sentence that says why the numbers are others now"
        )
    if args.reason.strip().startswith(FORMULA):
        raise ValueError(
            f"--reason is {args.reason.strip()[:40]!r}; a spreadsheet would take it for a formula"
        )
    check(args.dir)
    found = facts(read(args.dir))
    path = Path(args.baseline)
    if args.update:
        return _update(found, path, args, say)
    findings = compare(found, baseline.read(path))
    code = exit_code(findings)
    for line in messages.lines(findings):
        say(line)
    if args.summary:
        with open(args.summary, "a", encoding="utf-8") as file:
            file.write(messages.summary(findings, code))
    return code


def calibrate(args, say) -> int:
    """nsbench calibrate"""
    from nsbench.gate.calibrate import calibrate as again
    from nsbench.results.consistency import check

    workers(args)
    check(args.dir)
    return again(Path(args.dir), args, say)


def compare(args, say) -> int:
    """nsbench compare"""
    from dataclasses import replace

    from nsbench.gate import baseline, messages
    from nsbench.gate.comparison import compare
    from nsbench.gate.facts import facts
    from nsbench.report.data import read
    from nsbench.results.consistency import check

    if not 0 <= args.rtol < 1:
        raise ValueError(f"--rtol is {args.rtol:g}; a number from 0 to 1 is needed")
    check(args.old)
    check(args.new)
    old, new = (
        {key: replace(f, config="") for key, f in facts(read(d)).items()}
        for d in (args.old, args.new)
    )
    lines = {key: baseline.line(fact, 0.0, "") for key, fact in old.items()}
    lines = {
        key: line if line.kind in ("class", "max") else replace(line, rtol=args.rtol)
        for key, line in lines.items()
    }
    findings = compare(new, lines)
    for text in messages.lines(findings):
        say(text)
    return FINE if any(f.outcome not in ("missing", "new") for f in findings) else NOTHING


def _update(found, path, args, say) -> int:
    from nsbench.gate import baseline, spreads
    from nsbench.gate.update import updated
    from nsbench.results.tables import write_atomically

    old = baseline.read(path) if path.exists() else {}
    lines, changes = updated(found, old, spreads.read(args.dir, found), args.reason.strip())
    if changes or not path.exists():
        write_atomically(path, baseline.text(lines).encode())
    for change in changes:
        say(change)
    say(f"{path}: {len(lines)} lines, {len(changes)} changed")
    if apart := sorted(
        {f"{x.case} {x.solver}" for x in lines} - {f"{f.case} {f.solver}" for f in found.values()}
    ):
        say(
            f"of {len(apart)} that these results do not hold, such as {apart[0]}, every line "
            f"stays; a line that is to go is "
            "deleted by hand"
        )
    return FINE
