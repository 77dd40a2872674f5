"""The form of a check of a finished run: a name, the problems it applies to, and a function.

A check is a function `check(run: RunView) -> Finding | None` of a run that its method calls ok. It
looks for one reason why the run may be no solution, or less accurate than claimed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nsbench.diagnostics.run_view import RunView
from nsbench.problem import LCS, Complementarity, Filippov, Hybrid

ANY_PROBLEM = (Complementarity, Filippov, LCS, Hybrid)
WITHOUT_JUMPS = (Complementarity, Filippov, LCS)  # whose states lie on the polygon of the samples


@dataclass(frozen=True)
class Finding:
    """A reason not to call a run ok: the status it gets, and one sentence a person can act on."""

    status: str
    message: str


@dataclass(frozen=True)
class Check:
    """A check of a run that ended well, under the name that the column `check` shows.

    name: value of the column `check`, e.g. "late_exit". problem: the problem classes that are
    checked. find: the check itself; the first lines of its docstring are its entry in
    docs/statuses.md. gives: the statuses its findings can have. even_if_exact: the check acts on
    cases with a closed form too, whose errors are measured anyway. criterion: when it finds
    something, as an inequality in words, with the thresholds of its module.
    """

    name: str
    problem: type | tuple[type, ...]
    find: Callable[[RunView], Finding | None]
    gives: tuple[str, ...]
    even_if_exact: bool = False
    criterion: str = ""

    @property
    def source(self) -> str:
        """Return the file of the function, from the root of the repository."""
        function = getattr(self.find, "func", self.find)  # a method binds its options by `partial`
        return f"{function.__module__.replace('.', '/')}.py"

    def applies_to(self, run: RunView) -> bool:
        """Is the run one of a problem that is checked, and its solution not known exactly?"""
        return isinstance(run.case.problem, self.problem) and (
            self.even_if_exact or run.case.exact is None
        )
