"""A bound on the distance of a followed path from the solution, and the proof that its signs hold.

On a piece S of a step with the polynomials p (state) and w (unknowns) let R be the residual of w
and delta = p' - velocity(p, w). The reduced flow F(t, x) = velocity(x, u(x)) has in p the defect
delta + V_u R_u^-1 R, so with the logarithmic norm mu of F's Jacobian over a tube about p the
distance r in the 2-norm grows at most as

    r' <= mu r + |delta| + |V_u R_u^-1 R|        (Hairer, Norsett and Wanner I, theorem I.10.6).

Values of delta, R and of all watched numbers are Taylor polynomials about a point of S with the
remainder taken from the series over all of S in balls. At an event the distance is joined by the
error of the event's time times the speeds on both sides. What is watched is then shown to be
positive for every state in the tube.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb

from nsbench.reference.certify.ball_algebra import Refused, lead
from nsbench.reference.certify.ball_series import Jet
from nsbench.reference.certify.high_precision_path import (
    BOUNDS,
    Digits,
    OperationCount,
    Path,
    precision,
)
from nsbench.reference.certify.local_bounds import TUBE, PieceBounds

PIECES = 4  # of a step, to begin with
COARSE = (
    2.0**-8
)  # defects above the truncation of a step are bounded on smaller pieces, down to this part of it
LOOSE = 0.5  # growth of the bound on a piece above which its balls are likely too wide
SMALLEST = 2.0**-22  # part of a step below which the proof is given up


@dataclass
class Bounds:
    """Hold proven bounds: state (2-norm), impulse, reaction (max norm), event times; notes: what
    was taken and not proven.
    """

    state: float = 0.0
    impulse: float = 0.0
    reaction: float = 0.0
    times: tuple = ()
    notes: tuple = ()


def enclose(path: Path, digits: Digits) -> Bounds:
    """Bound the distance of a path from the solution through its start.

    Raises Refused if a sign does not hold or cannot be shown.
    """
    with precision(digits):
        fine = 10.0 ** (2.0 - digits.digits)
        return ErrorTube(path, fine, OperationCount(BOUNDS * digits.operations)).run()


class ErrorTube:
    """Carry the error bound r along the path, piece by piece, and prove the watched signs in the
    tube.
    """

    def __init__(self, path, fine, count):
        self.path = path
        self.fine = fine
        self.count = count
        self.r = 0.0
        self.largest = 0.0
        self.impulse = 0.0
        self.reaction = 0.0
        self.times = []
        self.notes = []

    def run(self) -> Bounds:
        """Advance the bound over all pieces and events; return the bounds of the whole path."""
        for k, piece in enumerate(self.path.pieces):
            if k:
                self._join(self.path.pieces[k - 1], piece)
            if piece.flow.shut:
                self.notes.append(
                    f"{', '.join(map(str, piece.flow.shut))} stay closed with the others on the "
                    f"arc up to "
                    f"t = {float(piece.end):.6g} (shown to {self._shut(piece):.0e}, not proven)"
                )
            for j, st in enumerate(piece.steps):
                if j and st.choices != piece.steps[j - 1].choices:
                    self._bend(piece, piece.steps[j - 1], st)
                self._step(piece, st)
        return Bounds(
            self.largest,
            self.impulse,
            self.reaction,
            tuple(self.times),
            tuple(dict.fromkeys(self.notes)),
        )

    def _shut(self, piece) -> float:
        """Bound the gaps of the contacts that are closed without being active, at the ends and
        middles of the steps.
        """
        rows = {r.id: r for r in piece.flow.all_rows}
        worst = 0.0
        for st in piece.steps:
            for part in (0, 0.5, 1):
                time = (st.t + st.h * arb(part)).mid()
                point = piece.flow.at(
                    Jet.of([time, 1], 2), [Jet.of([v], 1) for v in st.state(time)]
                )
                worst = max(
                    [worst, *(abs(float(lead(point.gap(rows[c])))) for c in piece.flow.shut)]
                )
        if worst > 1e-12:
            raise Refused(
                f"contacts {piece.flow.shut} are said to stay closed up to t = "
                f"{float(piece.end):.9g}; they are "
                f"off by {worst:.1e}"
            )
        return max(worst, 1e-40)

    def _step(self, piece, st):
        """Advance the bound over one Taylor step, halving pieces until every proof succeeds."""
        h = float(st.h)
        todo = [(h * (k / PIECES), h * ((k + 1) / PIECES)) for k in reversed(range(PIECES))]
        while todo:
            a, b = todo.pop()
            self.count.check(float(st.t) + a)
            why = self._piece(piece, st, a, b, a == 0.0, b == h)
            if why is not None:
                if b - a < SMALLEST * max(h, 1e-9):
                    raise Refused(why)
                todo += [(0.5 * (a + b), b), (a, 0.5 * (a + b))]

    def _piece(self, piece, st, a, b, first, last):
        """Advance the bound over [a, b] of a step; return a sentence if a proof fails there."""
        # the ends of a step are not floats: a last piece is seen from the end itself, and a little
        # longer than it is
        centre = arb(a) if first else st.h if last else arb(0.5 * (a + b))
        low, high = (
            (0.0, b - a)
            if first
            else ((a - b) * (1 + 1e-9), 0.0)
            if last
            else (0.5 * (a - b), 0.5 * (b - a))
        )
        where = f"between t = {float(st.t) + a:.9g} and {float(st.t) + b:.9g}"
        try:
            local = PieceBounds(piece.flow, st, centre, low, high, self.r)
        except (ArithmeticError, ValueError) as e:  # balls that hold zero where they are divided by
            return f"{where}: {e}"
        if not local.finite:
            return f"{where} the equations cannot be bounded"
        grow = local.mu * (high - low)
        if (local.defect > self.fine or grow > LOOSE) and b - a > COARSE * float(st.h):
            return f"{where} the defect is {local.defect:.1e}, its growth {grow:.1e}"
        r = float(
            (
                arb(grow).exp()
                * (arb(self.r) + arb(local.defect) * (high - low) * arb(abs(grow)).exp())
            ).upper()
        )
        if not (grow < 50.0 and r < TUBE / 10):
            return f"{where} the error bound leaves the tube: {r:.1e}"
        bad = local.wrong_sign(max(r, self.r), first, last)
        if bad is not None:
            return f"{where} {bad}"
        top = max(r, self.r)
        self.impulse += (b - a) * (local.du * top + local.dw)
        self.reaction += (b - a) * (local.dforce * top + local.dw * local.force_u)
        self.r, self.largest = r, max(self.largest, r)
        self.notes += [
            f"{n} on the arc up to t = {float(piece.end):.6g} (not proven)" for n in local.notes
        ]
        return None

    def _join(self, before, after):
        """Bound the error of an event's time and what it adds to the error of the state."""
        self.times.append(
            self._pass(
                before.flow, before.steps[-1], after.flow, after.steps[0], before.arc.triggers
            )
        )
        self.r += after.moved
        self.largest = max(self.largest, self.r)

    def _bend(self, piece, old, new):
        """Do the same at a kink of the drift: deciders that changed their choice."""
        turned = [
            ("kink", k)
            for k, (a, b) in enumerate(zip(old.choices, new.choices, strict=True))
            if a != b
        ]
        self._pass(piece.flow, old, piece.flow, new, turned)

    def _pass(self, flow, old, next_flow, new, keys) -> float:
        """Bound the time at which the numbers `keys` vanish at the end of the step `old`; add its
        share to the state's error.
        """
        end = PieceBounds(flow, old, old.h, -1e-12 * float(old.h), 0.0, self.r, series=2)
        begin = PieceBounds(next_flow, new, arb(0), 0.0, 1e-12 * float(new.h), self.r, series=2)
        miss = 0.0
        where = float(new.t)
        if not (end.finite and begin.finite):
            raise Refused(f"the equations cannot be bounded at t = {where:.9g}")
        for key in keys:
            rate = end.rate[key].abs_lower()
            error = (
                end.watch[key][0][0].abs_upper()
                + arb(end.slopes[key] * self.r + end.by_u[key] * end.dw)
            ) / rate
            if not error.is_finite() or not error < TUBE:
                raise Refused(
                    f"the event of {key[1]} at t = {where:.9g} is not transversal: its time "
                    f"cannot be bounded"
                )
            miss = max(miss, float(error.upper()))
        self.impulse += miss * (end.size_u + begin.size_u)
        self.reaction += miss * (end.size_force + begin.size_force)
        self.r = 1.01 * (self.r + miss * (end.speed + begin.speed))
        self.largest = max(self.largest, self.r)
        return miss
