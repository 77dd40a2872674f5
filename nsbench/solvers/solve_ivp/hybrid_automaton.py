"""Hybrid automaton of one problem, as a user of solve_ivp writes it by hand: a Script of modes.

A script is a set of arcs, which need work on paper first. Each has its right-hand side, in plain
Python numbers (for so few unknowns they are quicker than arrays), and the events that end it, each
with the arc that follows. Behind the n entries of the state come the integrals of the multipliers
(Filippov: of the weight of the positive side), one for each contact, and then, where gradients
turn, n entries of the reaction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Exit:
    """Event that ends an arc: when(t, y) crosses zero upwards (direction 1) or downwards (-1).

    then: the arc that follows, its name or a function (t, y) -> name. kind, contact: how the event
    is recorded; kind "" records nothing.
    """

    when: Callable
    direction: int
    then: str | Callable
    kind: str
    contact: tuple = (0, 0)


@dataclass(frozen=True)
class Arc:
    """Motion in one mode: rhs(t, y) -> list, and the exits that end it.

    enter(t, y): brings the state onto its surface, in place, where the arc begins.
    """

    rhs: Callable
    exits: tuple[Exit, ...] = ()
    enter: Callable = lambda t, y: None


@dataclass(frozen=True)
class Script:
    """Arcs of a case by name, and the name of the first one.

    contacts: ids of the integrals behind the state. push (m, n): the gradients, if they are
    constant; None: the reaction is integrated too; () for Filippov systems. max_step: of the
    integrator, where an excursion would be missed otherwise.
    """

    arcs: dict[str, Arc]
    first: str
    contacts: tuple = ((0, 0),)
    push: tuple | np.ndarray | None = ()
    max_step: float = math.inf
