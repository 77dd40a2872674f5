"""Hybrid systems: modes with a drift each, transitions between them, and resets of the state.

    x' = f_m(t, x) in the mode m;    (m, x) becomes (m', r(t, x)) where a guard of m passes zero

The mode is a memory: which field acts at x depends on how x was reached. A relay without memory, on
whose surface the motion may slide, is a Filippov system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from nsbench.input_errors import check_factory, named_fields, nearest
from nsbench.problem.constraints import Factory


@named_fields
@dataclass(frozen=True, eq=False)
class Transition:
    """Leave the mode `source` for the mode `target` where guard(t, x) passes zero upwards.

    guard: factory ``guard(xp) -> (t, x) -> number``. direction: +1, or -1 for a guard that passes
    zero downwards. reset: factory ``reset(xp) -> (t, x) -> (n,)`` of the state after the
    transition, from the one before; None: the state stays as it is. A transition from a mode to
    itself resets the state alone.
    """

    source: str
    guard: Factory
    target: str
    reset: Factory | None = None
    direction: int = 1

    def __post_init__(self):
        check_factory("guard", self.guard, "c(t, x)")
        if self.reset is not None:
            check_factory("reset", self.reset, "r(t, x)")
        if self.direction not in (1, -1):
            raise ValueError(
                f"direction is {self.direction!r}; +1 (the guard rises through zero) or -1 (it "
                "falls)"
            )


@named_fields
@dataclass(frozen=True, eq=False)
class Hybrid:
    """x' = f_m(t, x) in mode m; transitions change the mode and may reset the state.

    modes: maps names to drifts, ``drift(xp) -> (t, x) -> (n,)``. transitions: a tuple of
    `Transition`. initial: mode at the start; None: the first of `modes`.

    A transition fires where its guard passes zero in the stated direction, and at once where the
    guard has passed it already when its source mode is entered (positive; negative for direction
    -1). A guard at zero fires if the motion goes on to the far side. A transition from a mode to
    itself that leaves its guard as it is fires again only after the guard was negative. Where
    several fire at one instant the first of the list does, and then those of the mode that it leads
    to. At an instant of transitions the state is the last one, the limit from the right; the first
    sample of a run is the start of the case.

    The "multipliers" of a system of several modes are their indicators: `impulse` is the time spent
    in each mode, with contact (0, i) for mode i. Events are of the kind "transition", with contact
    (0, k) for transition k.
    """

    modes: Mapping[str, Factory]
    transitions: tuple[Transition, ...]
    initial: str | None = None
    kind: ClassVar[str] = "hybrid system"

    def __post_init__(self):
        if not isinstance(self.modes, Mapping) or not self.modes:
            raise TypeError(
                f"modes is {type(self.modes).__name__} {self.modes!r:.60}; a dict from names to "
                'drifts is needed, such as {"on": heat, "off": cool}'
            )
        for name, drift in self.modes.items():
            check_factory(f"modes[{name!r}]", drift, "f(t, x)")
        if isinstance(self.transitions, Transition):
            raise TypeError(
                "transitions is one Transition; a tuple of them is needed: "
                "transitions=(Transition(...),), with the comma"
            )
        for k, transition in enumerate(self.transitions):
            if not isinstance(transition, Transition):
                raise TypeError(f"transition {k} is {transition!r:.60}; a Transition is needed")
            self._check_mode(f"source of transition {k}", transition.source)
            self._check_mode(f"target of transition {k}", transition.target)
        initial = next(iter(self.modes)) if self.initial is None else self.initial
        self._check_mode("initial", initial)
        object.__setattr__(self, "modes", dict(self.modes))
        object.__setattr__(self, "transitions", tuple(self.transitions))
        object.__setattr__(self, "initial", initial)

    def _check_mode(self, what: str, name: str) -> None:
        if name not in self.modes:
            close = nearest(str(name), map(str, self.modes))
            raise ValueError(f"{what} is {name!r}, no mode; {close}")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the modes, in order."""
        return tuple(self.modes)

    @property
    def contacts(self) -> tuple[tuple[int, int], ...]:
        """Return the ids of the modes, (0, i); none where there is one mode alone."""
        count = len(self.modes)
        return tuple((0, i) for i in range(count)) if count > 1 else ()
