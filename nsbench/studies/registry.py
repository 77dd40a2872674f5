"""Registry of the studies: name, question and module, without importing any of them."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType


@dataclass(frozen=True)
class Study:
    """One study.

    name: on the command line and of its files. question: one sentence. module: defines
    `conduct(effort) -> Finding`.
    """

    name: str
    question: str
    module: str

    def load(self) -> ModuleType:
        """Import the module of the study."""
        return import_module(self.module)


STUDIES = (
    Study(
        "lemma",
        "Is the violation that one sweep leaves bounded by a constant times the violation that it "
        "found, whatever the number of discs and the order of the sweep?",
        "nsbench.studies.lemma.study",
    ),
    Study(
        "chain",
        "How far does a single violation travel through a packing in one sweep, and how does that "
        "depend on the order of the projections?",
        "nsbench.studies.chain.study",
    ),
    Study(
        "fan",
        "Which steps make the global error of a method, how does the exact flow change their local "
        "defects on the way to the end, and how far does one step pull two states apart?",
        "nsbench.studies.fan.study",
    ),
    Study(
        "plateau",
        "Does PBD stop converging at an error of C + M h with C > 0?",
        "nsbench.studies.plateau.study",
    ),
    Study(
        "stability",
        "Up to which step, stiffness, number, angle and height does every method stay stable, and "
        "does a stack stay still?",
        "nsbench.studies.stability.study",
    ),
    Study(
        "budget",
        "One small step of PBD or one large step of catching-up: which gives more for the same "
        "seconds, and is the numerical error small beside that of the model?",
        "nsbench.studies.budget.study",
    ),
    Study(
        "multipliers",
        "How many steps do multipliers need until they are right, what do sweeps, orders, steps "
        "and warm starts buy at equal cost, and how good are the error bars?",
        "nsbench.studies.multipliers.study",
    ),
)


def find_study(name: str) -> Study:
    """Return the study of this name. Raises LookupError with the nearest match."""
    known = {study.name: study for study in STUDIES}
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise LookupError(f"no study {name!r}{hint} (studies: {', '.join(known)})")
