"""The Case dataclass: a problem with its start, sample times and what is known of its solution."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nsbench.case.scale import Scale
from nsbench.case.spec import format_value
from nsbench.case.validation import check_shapes
from nsbench.html_summary import summary_table
from nsbench.input_errors import named_fields, nearest
from nsbench.problem import LCS, Complementarity, Filippov, Hybrid, float_array

START_POLICIES = ("error", "project", "keep")


@named_fields
@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """State a problem with its initial value, its sample times and what is known of its solution.

    Attributes (times and states are in the units of the problem, float64):

    name        letters, digits, "_", ".", "-"; at most 80
    problem     Complementarity, Filippov, Hybrid or LCS
    x0          (n,) initial state
    t           (k,) sample times, increasing; t[0] is the start and t[-1] = T
    exact       t -> (k, n), closed form of the state, or None
    exact_impulse  t -> (k, m), closed form of the cumulative multipliers, ordered as `contacts`
    exact_events   known event times, or None
    contacts    ids of the columns of `exact_impulse` (default: the rows of the families in order,
                without "all pairs" families)
    start       policy for an infeasible x0: "error", "project" (nearest feasible point) or "keep"
    unique      False where the solution itself is not unique (repulsive sliding): such a case can
                have no reference
    distance    (t, x) -> float, only where unique is False: distance of the samples x (k, n) at
                t (k,) to the set of all solutions: the least, over all of them, of the largest
                difference at any sample
    substeps    fewest steps between two samples in the step ladder of fixed-step methods
    also        further methods of the standard suite, such as "pbd[order=reverse]"
    tags        free words for filters
    params      parameters that the case was built with
    radius      of particles, for pictures
    scale       units of the case, a `Scale` of its time and coordinates: tolerances of methods are
                relative to them; None: they are found from the start
    references  folder in which references of the case are stored; "": that of the package
    doc, source description and file, filled in by the registry

    Raises ValueError or TypeError that names the field and the value if the data do not fit
    together; every function of the case is evaluated once at the start (`check_shapes`).
    """

    name: str
    problem: Any
    x0: Any
    t: Any
    exact: Callable | None = None
    exact_impulse: Callable | None = None
    exact_events: Any = None
    contacts: tuple | None = None
    start: str = "error"
    unique: bool = True
    distance: Callable | None = None
    substeps: int = 2
    also: tuple[str, ...] = ()
    tags: tuple[str, ...] = ()
    params: dict = field(default_factory=dict)
    radius: float | None = None
    scale: Scale | None = None
    references: str = ""
    doc: str = ""
    source: str = ""

    def __post_init__(self):
        if not (isinstance(self.name, str) and re.fullmatch(r"[A-Za-z0-9_.-]{1,80}", self.name)):
            raise ValueError(
                f"case name {str(self.name)[:100]!r}: letters, digits, '_', '.', '-', at most 80"
            )
        if not isinstance(self.problem, (Complementarity, Filippov, Hybrid, LCS)):
            raise TypeError(
                f"problem of {self.name} is {type(self.problem).__name__}; "
                "Complementarity, Filippov, Hybrid or LCS is needed"
            )
        object.__setattr__(self, "x0", float_array(f"x0 of {self.name}", self.x0, 1))
        if not self.x0.size:
            raise ValueError(f"x0 of {self.name} is empty; a state has at least one coordinate")
        t = float_array(f"t of {self.name}", self.t, 1)
        if len(t) < 2 or np.any(np.diff(t) <= 0):
            where = int(np.argmax(np.diff(t) <= 0)) if len(t) > 1 else 0
            raise ValueError(
                f"t of {self.name} must increase and hold at least two times; it is "
                f"{', '.join(f'{v:g}' for v in t[where : where + 2])} there"
            )
        object.__setattr__(self, "t", t)
        if self.start not in START_POLICIES:
            close = nearest(str(self.start), START_POLICIES)
            raise ValueError(f"start of {self.name} is {self.start!r:.60}; {close}")
        if self.scale is not None and not isinstance(self.scale, Scale):
            raise TypeError(
                f"scale of {self.name} is {type(self.scale).__name__}; Scale(time, state) is needed"
            )
        if self.unique and self.distance is not None:
            raise ValueError(
                f"{self.name} gives the distance to a set of solutions, but says that there is "
                f"one: unique=False?"
            )
        check_shapes(self)

    def __repr__(self) -> str:
        """Return name, problem class and sizes; the data are attributes."""
        return (
            f"Case({self.key}: {type(self.problem).__name__}, n = {self.n}, "
            f"t = {self.t[0]:g} .. {self.t[-1]:g}, {len(self.t)} samples)"
        )

    def _repr_html_(self) -> str:
        """Return name, class, sizes and the first line of the text as a table, for notebooks."""
        families = getattr(self.problem, "constraints", ())
        known = {"state": self.exact, "multipliers": self.exact_impulse}
        lines = [
            ("problem", type(self.problem).__name__),
            ("constraints", ", ".join(type(c).__name__ for c in families) or "none"),
            ("coordinates", self.n),
            ("time", f"{self.t[0]:g} to {self.t[-1]:g}, {len(self.t)} samples"),
            ("closed form", ", ".join(k for k, v in known.items() if v is not None) or "none"),
            ("tags", ", ".join(self.tags) or "none"),
            ("text", (self.doc.strip().splitlines() or [""])[0]),
        ]
        return summary_table(self.key, lines)

    @property
    def n(self) -> int:
        """Return the number of state coordinates."""
        return self.x0.size

    @property
    def own_time(self) -> float:
        """Return the length of the run, 1 at most: the longest time that look-aheads are parts of.

        Of a case in its own units, where the motion goes about its size in the time 1. What happens
        early must not depend on when the run ends.
        """
        return min(1.0, float(self.t[-1] - self.t[0]))

    @property
    def key(self) -> str:
        """Return the name with its parameters as typed: ``discs[n=30,seed=0]``."""
        inner = ",".join(f"{k}={format_value(v)}" for k, v in self.params.items())
        return f"{self.name}[{inner}]" if inner else self.name

    @property
    def classes(self) -> tuple[str, ...]:
        """Return the words that `Expect` clauses of methods refer to.

        Problem class, properties that follow from the data, tags.
        """
        kind = type(self.problem).__name__.lower()
        words = [kind, *self.tags]
        if kind == "complementarity" and not self.problem.constraints:
            words.append("smooth")
        if kind == "hybrid" and len(self.problem.modes) == 1:
            words.append("one_mode")
        if not self.unique:
            words.append("not_unique")
        return tuple(dict.fromkeys(words))

    def replace(self, **changes: Any) -> Case:
        """Return a copy of the case with some fields changed."""
        return dataclasses.replace(self, **changes)
