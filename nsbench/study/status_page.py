"""Generate docs/statuses.md: the closed list of statuses, and the checks and files that give one.

`python -m nsbench.study.status_page > docs/statuses.md` writes the page from the registry of checks
and the checks that methods bring; a test compares it with the committed page.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from typing import NamedTuple

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
closed form: there the error is measured. Criteria have the thresholds of the file that is named,
where the reasons for them stand; width is that of a regularisation layer, in values of the switch.

"""
OTHERS_HEAD = """
## Statuses without a check

The column `check` is empty, and a run that reached its end time is not `ok`, where the method or
the bench found one of these itself.

"""
ELSEWHERE = """
A run that stopped before its end time has the status of its method, from the folder of the method
or from `nsbench/solvers/common`: `diverged`, `nan`, `infeasible`, `degenerate`, `chatter`,
`maxiter`. `refused`, `error` and `below_reference` are set in `nsbench/study/attempt.py`;
`timeout`, `oom` and `crashed` in `nsbench/execute/workers/pool.py` and, of clusters, in
`nsbench/execute/cluster`.
"""


class Unchecked(NamedTuple):
    """A status of a run that reached its end time, set without a check.

    sentence: its words as they stand in `source`, a file, without the values; when: the criterion.
    """

    status: str
    sentence: str
    when: str
    source: str


WITHOUT_CHECK = (
    Unchecked(
        "unverified",
        "was not reached: the error bar is",
        "a run for a tolerance has made PASSES passes, or would need more steps than MOST_STEPS",
        "nsbench/solvers/common/tolerance_run.py",
    ),
    Unchecked(
        "unverified",
        "No step can be chosen.",
        "a run for a tolerance has no error bars",
        "nsbench/solvers/common/tolerance_run.py",
    ),
    Unchecked(
        "unverified",
        "was solved with a KKT residual",
        "the largest KKT residual of the QPs is above MAX_KKT of the state",
        "nsbench/solvers/catching_up/method.py",
    ),
    Unchecked(
        "degenerate",
        "Coincident centres: the contact has no normal; the first axis was taken.",
        "the centres of two particles coincide in a step",
        "nsbench/solvers/catching_up/method.py",
    ),
    Unchecked(
        "degenerate",
        "they were parted along the first axis.",
        "the centres of two particles coincide in a step",
        "nsbench/solvers/pbd/method.py",
    ),
    Unchecked(
        "unverified",
        "it is not known whether its motion is the only one.",
        "a step may have several motions, and has more rows than ALL, up to which all are tried",
        "nsbench/solvers/theta/method.py",
    ),
    Unchecked(
        "degenerate",
        "has several solutions with different motions.",
        "a complementarity problem has several solutions, and they move the state differently",
        "nsbench/solvers/theta/method.py",
    ),
    Unchecked(
        "unverified",
        "it is not known whether another motion exists.",
        "more rows than MAX_ENUMERATED_ROWS that are neither of a P-matrix nor passive",
        "nsbench/solvers/event_driven/lcs/loop.py",
    ),
    Unchecked(
        "unverified",
        "Samples are missing although no failure was met.",
        "a state is not finite, or was not recorded, in a run without a failure",
        "nsbench/solvers/event_driven/contacts/host_loop.py",
    ),
    Unchecked(
        "unverified",
        "changed while runs were made: with which text this one was made cannot be told.",
        "a file that the run depends on was edited since the command began",
        "nsbench/results/row_reuse.py",
    ),
)


def generate_status_page() -> str:
    """Return the page as Markdown."""
    lines = ["| status | meaning |", "| --- | --- |"]
    lines += [f"| `{code}` | {meaning} |" for code, meaning in STATUS_MEANINGS.items()]
    out = HEAD + "\n".join(lines) + "\n" + CHECKS_HEAD + _table(CHECKS)
    for name, checks in _method_checks():
        out += f"\n## Checks of {name}\n\n" + _table(checks)
    lines = ["| status | sentence | when | file |", "| --- | --- | --- | --- |"]
    lines += [f"| `{u.status}` | {u.sentence} | {u.when} | `{u.source}` |" for u in WITHOUT_CHECK]
    return out + OTHERS_HEAD + "\n".join(lines) + "\n" + ELSEWHERE


def _method_checks() -> Iterable[tuple[str, tuple[Check, ...]]]:
    """Yield the methods that bring checks of their own, by name, with these."""
    for name in solvers.all_names():
        checks = getattr(solvers.get(name), "checks", ())
        if checks:
            yield name, checks


def _table(checks: Iterable[Check]) -> str:
    lines = [
        "| check | problem | what it does | criterion | gives | | file |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for c in checks:
        problems = c.problem if isinstance(c.problem, tuple) else (c.problem,)
        lines.append(
            f"| `{c.name}` | {', '.join(p.__name__ for p in problems)} | {_summary(c)} | "
            f"{c.criterion} | {', '.join(f'`{s}`' for s in c.gives)} | "
            f"{'always' if c.even_if_exact else ''} | `{c.source}` |"
        )
    return "\n".join(lines) + "\n"


def _summary(check: Check) -> str:
    """Return the docstring of a check as one line of a table."""
    find = getattr(check.find, "func", check.find)  # a method binds its options by `partial`
    return " ".join((inspect.getdoc(find) or "").split()).replace("|", "\\|")


if __name__ == "__main__":
    print(generate_status_page(), end="")
