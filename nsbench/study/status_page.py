"""Generate docs/statuses.md: the closed list of statuses, and the checks that can give one.

`python -m nsbench.study.status_page > docs/statuses.md` writes the page from the registry of checks
and the checks that methods bring; a test compares it with the committed page.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from nsbench import solvers
from nsbench.diagnostics import CHECKS, Check
from nsbench.trajectory import STATUS_MEANINGS

HEAD = """# Statuses of a run

Every attempted run has one status of a closed list and, unless it is `ok`, a sentence that says
why. The column `check` names the check that gave the status, and is empty where the method itself
or the bench did. This page is generated: `python -m nsbench.study.status_page > docs/statuses.md`.

"""
CHECKS_HEAD = """
## Checks of a finished run

A run that its method calls `ok` is checked once, outside of what the clock measures
(`nsbench.diagnostics`). The first finding in the order of this table counts; checks of a method
precede the others. Except for those marked *always*, checks are left out where the case has a
closed form: there the error is measured.

"""


def generate_status_page() -> str:
    """Return the page as Markdown."""
    lines = ["| status | meaning |", "| --- | --- |"]
    lines += [f"| `{code}` | {meaning} |" for code, meaning in STATUS_MEANINGS.items()]
    out = HEAD + "\n".join(lines) + "\n" + CHECKS_HEAD + _table(CHECKS)
    for name, checks in _method_checks():
        out += f"\n## Checks of {name}\n\n" + _table(checks)
    return out


def _method_checks() -> Iterable[tuple[str, tuple[Check, ...]]]:
    """Yield the methods that bring checks of their own, by name, with these."""
    for name in solvers.all_names():
        checks = getattr(solvers.get(name), "checks", ())
        if checks:
            yield name, checks


def _table(checks: Iterable[Check]) -> str:
    lines = ["| check | problem | what it does | gives | |", "| --- | --- | --- | --- | --- |"]
    for c in checks:
        problems = c.problem if isinstance(c.problem, tuple) else (c.problem,)
        lines.append(
            f"| `{c.name}` | {', '.join(p.__name__ for p in problems)} | {_summary(c)} | "
            f"{', '.join(f'`{s}`' for s in c.gives)} | {'always' if c.even_if_exact else ''} |"
        )
    return "\n".join(lines) + "\n"


def _summary(check: Check) -> str:
    """Return the docstring of a check as one line of a table."""
    find = getattr(check.find, "func", check.find)  # a method binds its options by `partial`
    return " ".join((inspect.getdoc(find) or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    print(generate_status_page(), end="")
