"""Parts of a study that need no other part: here one after the other, or by several workers.

Values are those of the journal in either case: what JSON makes of them, in the order of the parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from nsbench.studies.part_journal import PartJournal

Task = tuple[Callable, tuple]  # a function and its arguments
OnValue = Callable[[int, object], None]
# computes tasks, several at a time; calls OnValue with the number and the value of each as it ends
Workers = Callable[[Sequence[Task], OnValue], None]


@dataclass(frozen=True)
class Part:
    """A part whose value is function(*args), where function and arguments can be pickled.

    key: in the journal. words: the line of progress.
    """

    key: str
    words: str
    function: Callable
    args: tuple = ()


def compute_here(
    parts: Sequence[Part], journal: PartJournal, report: Callable[[str], None]
) -> list:
    """Compute parts one after the other in this process; return their values in order."""
    out = []
    for part in parts:
        report(part.words)
        out.append(journal.part(part.key, partial(part.function, *part.args)))
    return out


def compute_elsewhere(
    parts: Sequence[Part], journal: PartJournal, report: Callable[[str], None], workers: Workers
) -> list:
    """Let workers compute the parts that the journal lacks; return the values of all in order.

    A value is stored, and reported, as soon as it is there. What a part raises is raised here.
    """
    missing = [part for part in parts if not journal.knows(part.key)]
    stored = []

    def store(number: int, value: object) -> None:
        part = missing[number]
        stored.append(journal.part(part.key, lambda: value))
        report(f"{part.words} ({len(stored)} of {len(missing)} done)")

    if missing:
        report(f"{len(missing)} parts by several workers, from {missing[0].words} on")
        workers([(part.function, part.args) for part in missing], store)
    return [journal.part(part.key, partial(part.function, *part.args)) for part in parts]
