"""High-precision path: follow the claimed arcs by Taylor steps, events by Newton's method.

Nothing is chosen here: an arc whose claimed event is not where the run saw it, or which does not
start on its constraints, is refused with a sentence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from flint import arb, arb_mat, ctx

from nsbench.case import Case
from nsbench.problem import Complementarity
from nsbench.reference.certify.ball_algebra import Refused, lead, solve
from nsbench.reference.certify.ball_series import Jet
from nsbench.reference.certify.claimed_arcs import Arc
from nsbench.reference.certify.constraint_list import rows_of
from nsbench.reference.certify.contact_flow import ContactFlow, make_flow
from nsbench.reference.certify.dual_numbers import Dual
from nsbench.reference.certify.taylor_step import Step, first_kink, root, step

REACH = 1e-6  # an event may be this far from where the run saw it, relative to the run's length
SAME = 1e-25  # events of one instant agree to this
ON = 1e-7  # an arc may start this far from its constraints before its end is polished
WRONG = 1e-12  # a watched number this far below zero at the end of a step is wrong beyond doubt
MOST_STEPS = 20_000
BOUNDS = 4.0  # times the operations of a path bound it, about


@dataclass(frozen=True)
class Digits:
    """Hold the order of the series, the truncation of a step (decimal digits) and the working
    precision (bits).

    operations: most on series that the path may take; its bounds take BOUNDS times as many.
    """

    order: int
    digits: float
    bits: int
    operations: float = math.inf


class OperationCount:
    """Count the operations on series since this was made."""

    def __init__(self, most: float):
        self.most = most
        self.before = Jet.made

    def check(self, t: float) -> None:
        """Raise Refused if there were more than `most`; t: how far they have come."""
        if Jet.made - self.before > self.most:
            raise Refused(f"more than {self.most:.0e} operations on series by t = {t:.4g}")


@dataclass(eq=False)
class Piece:
    """Hold one arc as followed: start and end (arb), its flow and steps; moved: distance by which
    its start was projected onto its constraints.
    """

    arc: Arc
    flow: object
    start: arb
    moved: float = 0.0
    steps: list[Step] = field(default_factory=list)
    end: arb | None = None


@dataclass(eq=False)
class Path:
    """Hold the pieces and the samples: x (k, n), impulse (k, m) of `contacts`, reaction (k, n) as
    lists of arb.
    """

    pieces: list[Piece]
    contacts: tuple
    x: list
    impulse: list
    reaction: list
    moved: float  # how far the start was put onto constraints it violates or holds by rounding


class precision:
    """Set python-flint's working precision for a block and restore it."""

    def __init__(self, digits: Digits):
        self.digits = digits

    def __enter__(self):
        self.old = ctx.prec, ctx.cap
        ctx.prec = self.digits.bits
        ctx.cap = self.digits.order + 8

    def __exit__(self, *_):
        ctx.prec, ctx.cap = self.old


def follow(case: Case, arcs: list[Arc], digits: Digits, x0) -> Path:
    """Follow the arcs from x0; raise Refused where the path does not go on as claimed."""
    with precision(digits):
        return ArcFollower(case, arcs, digits, x0).run()


class ArcFollower:
    """Follow claimed arcs one after the other and sample them."""

    def __init__(self, case, arcs, digits, x0):
        self.case = case
        self.arcs = arcs
        self.digits = digits
        self.t, self.x = arb(float(case.t[0])), [arb(float(v)) for v in x0]
        self.rows = rows_of(case) if isinstance(case.problem, Complementarity) else None
        self.span = float(case.t[-1] - case.t[0])
        self.total, self.force = {}, [arb(0)] * (case.n if self.rows is not None else 0)
        self.samples = []
        self.taken = 0
        self.count = OperationCount(digits.operations)

    def run(self) -> Path:
        """Follow all arcs; return the path with its samples."""
        pieces = []
        moved = self._feasible()
        for k, arc in enumerate(self.arcs):
            flow = make_flow(self.case, arc, self.rows)
            piece = Piece(arc, flow, self.t, self._onto(flow, arc))
            if k and piece.moved > SAME:
                raise Refused(
                    f"after the event at t = {float(self.t):.12g} {_name(flow)} are said to be "
                    f"held; one of them "
                    f"is {piece.moved:.1e} away then: the run does not tell events apart that "
                    f"fall so close"
                )
            if k == 0:
                self._sample(None, self.t, include=True)
            self._arc(piece, last=k == len(self.arcs) - 1)
            pieces.append(piece)
        names = tuple(self.total)
        x, impulse, force = zip(*self.samples, strict=True)
        return Path(
            pieces,
            names,
            list(x),
            [[row.get(c, arb(0)) for c in names] for row in impulse],
            list(force),
            moved + pieces[0].moved,
        )

    def _feasible(self) -> float:
        """Project a start that violates constraints by rounding exactly onto them: what lies below
        ON counts as rounding.
        """
        if self.rows is None:
            return 0.0
        point = ContactFlow(self.case, (), (), self.rows).at(
            Jet.of([self.t, 1], 2), [Jet.of([v], 1) for v in self.x]
        )
        out = [r.id for r in self.rows if -1e-12 < float(lead(point.gap(r))) < 0.0]
        return (
            self._onto(ContactFlow(self.case, tuple(out), (), self.rows), self.arcs[0])
            if out
            else 0.0
        )

    def _onto(self, flow, arc) -> float:
        """Project the state onto the invariants of the arc along their gradients.

        Returns how far that is; raises Refused if it is far.
        """
        start = list(self.x)
        for _ in range(8):
            one = Jet.lift(None, 1.0)
            point = flow.at(
                Jet.of([self.t, 1], 2),
                [Dual(Jet.of([v], 1), {i: one}, 1) for i, v in enumerate(self.x)],
            )
            g = [v if isinstance(v, Dual) else Dual(v, {}) for v in flow.invariants(point)]
            off = max((abs(float(lead(v))) for v in g), default=0.0)
            if off > ON:
                raise Refused(
                    f"the arc that ends at t = {arc.end:.9g} is said to hold {_name(flow)}, which "
                    f"is "
                    f"{off:.2e} away at its start, t = {float(self.t):.9g}"
                )
            if off < 1e-40:
                break
            G = [{j: d.leading.at(0).mid() for j, d in v.d.items()} for v in g]
            M = arb_mat(
                [
                    [sum((a[j] * b[j] for j in a if j in b), start=arb(0)).mid() for b in G]
                    for a in G
                ]
            )
            mu = solve(M, [-lead(v).mid() for v in g])
            for m, grad in zip(mu, G, strict=True):
                for j, a in grad.items():
                    self.x[j] = (self.x[j] + m * a).mid()
        else:
            raise Refused(f"the state cannot be put on {_name(flow)} at t = {float(self.t):.9g}")
        return float(
            sum(((a - b) ** 2 for a, b in zip(self.x, start, strict=True)), start=arb(0))
            .sqrt()
            .upper()
        )

    def _arc(self, piece, last):
        """Follow one arc by Taylor steps to the event that ends it."""
        end = arb(float(self.case.t[-1])) if last else None
        goal = arb(piece.arc.end)
        choices = None
        while True:
            self.taken += 1
            if self.taken > MOST_STEPS:
                raise Refused(f"{MOST_STEPS} steps were taken by t = {float(self.t):.9g}")
            self.count.check(float(self.t))
            left = (end - self.t if last else goal - self.t + REACH * self.span).mid()
            st = step(
                piece.flow, self.t, self.x, self.digits.order, self.digits.digits, left, choices
            )
            h = float(st.h)
            kink = first_kink(st, h)
            final = None
            if last and (kink is None) and h >= float(left):
                final = left
            elif not last and self.t + h > goal - REACH * self.span:
                final = self._event(piece, st, goal)
            if kink is not None and (final is None or kink < final):
                st = _cut(st, kink)
                final = None
            elif final is not None:
                st = _cut(st, final)
            self._advance(piece, st)
            if final is not None:
                piece.end = self.t
                return

    def _event(self, piece, st, goal):
        """Find the time into the step at which the triggers are zero; None if the step does not
        reach it.
        """
        if not piece.arc.triggers:
            raise Refused(
                f"the run changes its mode at t = {piece.arc.end:.9g} without anything that "
                f"vanishes there"
            )
        found = []
        for key in piece.arc.triggers:
            if key not in st.watch:
                raise Refused(
                    f"at t = {piece.arc.end:.9g} {key[0]} of {key[1]} is said to vanish; the arc "
                    f"before does "
                    "not have it"
                )
            s = root(st.watch[key], (goal - st.t).mid(), 2 * REACH * self.span)
            if s is None:
                raise Refused(
                    f"{key[0]} of {key[1]} is said to vanish at t = {piece.arc.end:.9g}; it does "
                    f"not: it is "
                    f"{float(st.watch[key]((goal - st.t).mid()).mid()):.3e} there"
                )
            found.append(s)
        if max(abs(float(s - found[0])) for s in found) > SAME:
            raise Refused(
                f"the events at t = {piece.arc.end:.12g} are "
                f"{max(abs(float(s - found[0])) for s in found):.1e} "
                "apart: their order is not told by the run"
            )
        return found[0] if float(found[0]) <= float(st.h) else None

    def _advance(self, piece, st):
        """Advance time, state, impulses and reaction by one step, with the samples in it."""
        for (
            key,
            p,
        ) in st.watch.items():  # the proof looks everywhere; no need to go on from a bad place
            value = float(p(st.h).mid())
            if value < -WRONG:
                raise Refused(
                    f"{key[0]} of {key[1]} does not stay positive: it is {value:.3e} at t = "
                    f"{float(st.t + st.h):.12g}"
                )
        for time in self._inside(st):
            self._sample((piece, st), arb(time))
        self._add(self.total, piece, st, st.h)
        self.force = [(a + p(st.h)).mid() for a, p in zip(self.force, st.reaction, strict=True)]
        self.x = [p(st.h).mid() for p in st.x]
        self.t = (st.t + st.h).mid()
        piece.steps.append(st)

    def _inside(self, st):
        """Is the step ended by nothing before its length?"""
        times = self.case.t[len(self.samples) :]
        return [
            float(v)
            for v in times
            if arb(float(v)) <= st.t + st.h or (v >= self.case.t[-1] and _last(self, st))
        ]

    @staticmethod
    def _add(total, piece, st, s):
        for c, p in zip(piece.flow.names(), st.impulse, strict=True):
            total[c] = (total.get(c, arb(0)) + p(s)).mid()

    def _sample(self, where, time, include=False):
        """Evaluate the series at the sample times up to `time`."""
        if include:
            self.samples.append((list(self.x), dict(self.total), list(self.force)))
            return
        piece, st = where
        s = (time - st.t).mid()
        total = dict(self.total)
        self._add(total, piece, st, s)
        self.samples.append(
            (
                [p(s).mid() for p in st.x],
                total,
                [(a + p(s)).mid() for a, p in zip(self.force, st.reaction, strict=True)],
            )
        )


def _last(follower, st) -> bool:
    return float(st.t + st.h) >= float(follower.case.t[-1])


def _cut(st: Step, h: arb) -> Step:
    return Step(st.t, h, st.x, st.u, st.impulse, st.reaction, st.watch, st.choices, st.deciders)


def _name(flow) -> str:
    held = [r.id for r in flow.held] if hasattr(flow, "held") else [(0, i) for i in flow.on]
    return ", ".join(map(str, held)) or "nothing"


def event_times(path: Path) -> list[arb]:
    """List the ends of all pieces but the last."""
    return [p.end for p in path.pieces[:-1]]


def doubles(rows) -> np.ndarray:
    """Round rows of arb to float64, to nearest."""
    return np.array([[float(v.mid()) for v in row] for row in rows], float)
