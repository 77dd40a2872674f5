"""Studies of questions about sweeps and time-stepping that a convergence table does not answer.

A study asks one question and returns a `Finding`: the question, an answer made from the numbers,
tables and figures as evidence, what would refute it, and the command that repeats it.

    find_study("lemma").load().conduct(Effort(...))

Each study is a folder with a module `study.py` that defines `conduct(effort)`; a line in
`registry` makes it known. (nsbench.study, in the singular, runs cases with methods.)
"""

from __future__ import annotations

from nsbench.studies.registry import STUDIES, Study, find_study

__all__ = ["STUDIES", "Study", "find_study"]
