"""A bound on the distance of a followed path from the solution, and the proof that its signs hold.

On a piece S of a step with the polynomials p (state) and w (unknowns) let R be the residual of w and delta = p' -
velocity(p, w). The reduced flow F(t, x) = velocity(x, u(x)) has in p the defect delta + V_u R_u^-1 R, so with the
logarithmic norm mu of F's Jacobian over a tube about p the distance r in the 2-norm grows at most as

    r' <= mu r + |delta| + |V_u R_u^-1 R|        (Hairer, Norsett and Wanner I, theorem I.10.6).

Values of delta, R and of all watched numbers are Taylor polynomials about a point of S with the remainder taken from
the series over all of S in balls. At an event the distance is joined by the error of the event's time times the
speeds on both sides. What is watched is then shown to be positive for every state in the tube.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat, arb_poly

from nsbench.reference.flow import _lead
from nsbench.reference.follow import Digits, Path, Refused, precision
from nsbench.reference.jets import Dual, Jet
from nsbench.reference.namespace import Branches, noted, watching
from nsbench.reference.series import coefficients
from nsbench.reference.signs import MULTIPLE, ZERO, ball, order_of_zero, positive

TUBE = 1e-18            # radius of the tube over which derivatives are bounded; the path must stay far inside
PIECES = 4              # of a step, to begin with
COARSE = 2.0 ** -8      # defects above the truncation of a step are bounded on smaller pieces, down to this part of it
LOOSE = 0.5             # growth of the bound on a piece above which its balls are likely too wide
SMALLEST = 2.0 ** -22   # part of a step below which the proof is given up
ORDER = 30              # of the Taylor polynomials of defects on a piece: its length is a small part of a radius


@dataclass
class Bounds:
    """Proven bounds in exact arithmetic: state (2-norm), impulse, reaction (max norm), event times; `notes` says what
    was taken and not proven."""
    state: float = 0.0
    impulse: float = 0.0
    reaction: float = 0.0
    times: tuple = ()
    notes: tuple = ()


def enclose(path: Path, digits: Digits) -> Bounds:
    """Bounds of a path as a solution from where it starts. Refused where a sign does not hold or cannot be shown."""
    with precision(digits):
        return _Tube(path, 10.0 ** (2.0 - digits.digits)).run()


class _Tube:
    def __init__(self, path, fine):
        self.path, self.fine, self.r, self.largest = path, fine, 0.0, 0.0
        self.impulse, self.reaction, self.times, self.notes = 0.0, 0.0, [], []

    def run(self) -> Bounds:
        for k, piece in enumerate(self.path.pieces):
            if k:
                self._join(self.path.pieces[k - 1], piece)
            if piece.flow.shut:
                self.notes.append(f"{', '.join(map(str, piece.flow.shut))} stay closed with the others on the arc up to "
                                  f"t = {float(piece.end):.6g} (shown to {self._shut(piece):.0e}, not proven)")
            for j, st in enumerate(piece.steps):
                if j and st.choices != piece.steps[j - 1].choices:
                    self._bend(piece, piece.steps[j - 1], st)
                self._step(piece, st)
        return Bounds(self.largest, self.impulse, self.reaction, tuple(self.times), tuple(dict.fromkeys(self.notes)))

    def _shut(self, piece) -> float:
        """Largest gap of the contacts that are closed without being held, at the ends and middles of the steps."""
        rows = {r.id: r for r in piece.flow.all_rows}
        worst = 0.0
        for st in piece.steps:
            for part in (0, 0.5, 1):
                time = (st.t + st.h * arb(part)).mid()
                point = piece.flow.at(Jet.of([time, 1], 2), [Jet.of([v], 1) for v in st.state(time)])
                worst = max([worst, *(abs(float(_lead(point.gap(rows[c])))) for c in piece.flow.shut)])
        if worst > 1e-12:
            raise Refused(f"contacts {piece.flow.shut} are said to stay closed up to t = {float(piece.end):.9g}; they are "
                          f"off by {worst:.1e}")
        return max(worst, 1e-40)

    def _step(self, piece, st):
        h = float(st.h)
        todo = [(h * (k / PIECES), h * ((k + 1) / PIECES)) for k in reversed(range(PIECES))]
        while todo:
            a, b = todo.pop()
            why = self._piece(piece, st, a, b, a == 0.0, b == h)
            if why is not None:
                if b - a < SMALLEST * max(h, 1e-9):
                    raise Refused(why)
                todo += [(0.5 * (a + b), b), (a, 0.5 * (a + b))]

    def _piece(self, piece, st, a, b, first, last):
        """Advance the bound over [a, b] of a step; a sentence if a proof fails there."""
        # the ends of a step are not floats: a last piece is seen from the end itself, and a little longer than it is
        centre = arb(a) if first else st.h if last else arb(0.5 * (a + b))
        low, high = (0.0, b - a) if first else ((a - b) * (1 + 1e-9), 0.0) if last else (0.5 * (a - b), 0.5 * (b - a))
        where = f"between t = {float(st.t) + a:.9g} and {float(st.t) + b:.9g}"
        try:
            local = Local(piece.flow, st, centre, low, high, self.r)
        except (ArithmeticError, ValueError) as e:           # balls that hold zero where they are divided by
            return f"{where}: {e}"
        if not local.finite:
            return f"{where} the equations cannot be bounded"
        grow = local.mu * (high - low)
        if (local.defect > self.fine or grow > LOOSE) and b - a > COARSE * float(st.h):
            return f"{where} the defect is {local.defect:.1e}, its growth {grow:.1e}"
        r = float((arb(grow).exp() * (arb(self.r) + arb(local.defect) * (high - low) * arb(abs(grow)).exp())).upper())
        if not (grow < 50.0 and r < TUBE / 10):
            return f"{where} the error bound leaves the tube: {r:.1e}"
        bad = local.wrong_sign(max(r, self.r), first, last)
        if bad is not None:
            return f"{where} {bad}"
        top = max(r, self.r)
        self.impulse += (b - a) * (local.du * top + local.dw)
        self.reaction += (b - a) * (local.dforce * top + local.dw * local.force_u)
        self.r, self.largest = r, max(self.largest, r)
        self.notes += [f"{n} on the arc up to t = {float(piece.end):.6g} (not proven)" for n in local.notes]
        return None

    def _join(self, before, after):
        """Error of the event's time, and what it does to the state."""
        self.times.append(self._pass(before.flow, before.steps[-1], after.flow, after.steps[0], before.arc.triggers))
        self.r += after.moved
        self.largest = max(self.largest, self.r)

    def _bend(self, piece, old, new):
        """The same where the drift has a kink: deciders that changed their choice."""
        turned = [("kink", k) for k, (a, b) in enumerate(zip(old.choices, new.choices, strict=True)) if a != b]
        self._pass(piece.flow, old, piece.flow, new, turned)

    def _pass(self, flow, old, next_flow, new, keys) -> float:
        """Bound of the time at which the numbers `keys` vanish at the end of the step `old`; the state takes its share."""
        end = Local(flow, old, old.h, -1e-12 * float(old.h), 0.0, self.r, series=2)
        begin = Local(next_flow, new, arb(0), 0.0, 1e-12 * float(new.h), self.r, series=2)
        miss, where = 0.0, float(new.t)
        if not (end.finite and begin.finite):
            raise Refused(f"the equations cannot be bounded at t = {where:.9g}")
        for key in keys:
            rate = end.rate[key].abs_lower()
            error = (end.watch[key][0][0].abs_upper() + arb(end.slopes[key] * self.r + end.by_u[key] * end.dw)) / rate
            if not error.is_finite() or not error < TUBE:
                raise Refused(f"the event of {key[1]} at t = {where:.9g} is not transversal: its time cannot be bounded")
            miss = max(miss, float(error.upper()))
        self.impulse += miss * (end.size_u + begin.size_u)
        self.reaction += miss * (end.size_force + begin.size_force)
        self.r = 1.01 * (self.r + miss * (end.speed + begin.speed))
        self.largest = max(self.largest, self.r)
        return miss


class Local:
    """Ranges of everything on one piece: Taylor polynomials about its centre with remainders, and slopes in a tube.

    low, high: the piece relative to the centre. r: error bound at its start. mu, defect, du (bound of |du/dx|), dw (error
    of w), and for every watched key a polynomial, a bound of its remainder, and the bound of its slope.
    """

    def __init__(self, flow, st, centre, low, high, r, series=ORDER):
        self.flow, self.st, self.low, self.high, self.r, self.notes = flow, st, low, high, r, []
        c, span = centre, ball(low, high)
        self.time, self.ball = (st.t + c).mid(), (st.t + c).mid() + span
        shift = lambda p, s: p(arb_poly([s, 1]))
        length = series + 1
        at = [shift(p, c) for p in st.x], [shift(p, c) for p in st.u]
        over = [shift(p, c + span) for p in st.x], [shift(p, c + span) for p in st.u]
        self.slope_ranges(over)
        if not self.finite:
            return
        old = watching(Branches(st.choices))
        try:
            exact = self._series(at, self.time, length)
            watching(Branches(st.choices))
            wide = self._series(over, self.ball, length)
        finally:
            watching(old)
        width = max(-low, high)
        self.watch = {k: (polynomial(v, series), remainder(wide["watch"][k], series, width))
                      for k, v in exact["watch"].items()}
        self.rate = {k: v.leading.at(1) for k, v in wide["watch"].items()}
        bound = lambda name: float(sum((size(v, wide[name][k], series, width) ** 2
                                        for k, v in enumerate(exact[name])), start=arb(0)).sqrt().upper())
        residual = bound("residual")
        self.dw = self.inverse * residual
        self.defect = bound("defect") + self.velocity_u * self.dw

    def _series(self, polynomials, time, length):
        x, u = ([Jet.of([p[k] for k in range(length + 1)], length + 1) for p in part] for part in polynomials)
        slope = [v.derivative() for v in x]
        x, u = [Jet.of([v.at(k) for k in range(length)], length) for v in x], [
            Jet.of([v.at(k) for k in range(length)], length) for v in u]
        point = self.flow.at(Jet.of([time, 1], length + 1), x)
        velocity = point.velocity(u)
        return {"watch": self._watched(point, u),
                "residual": point.residual(u), "defect": [a - b for a, b in zip(slope, velocity, strict=True)]}

    def _watched(self, point, u):
        """What the flow watches, and the deciders of the kinks on the side that was chosen."""
        kinks = zip(noted(), self.st.choices, strict=True)
        return point.watch(u) | {("kink", k): (v if side else -v) for k, (v, side) in enumerate(kinks)}

    def slope_ranges(self, over):
        """Jacobians over the tube: mu of the reduced flow, du/dx, and slopes of what is watched."""
        n, m = self.flow.n, self.flow.m
        tube = arb(0, TUBE)
        x = [Dual(Jet.of([p[0] + tube], 1), {i: Jet.lift(None, 1.0)}) for i, p in enumerate(over[0])]
        u = [Dual(Jet.of([p[0] + tube], 1), {n + k: Jet.lift(None, 1.0)}) for k, p in enumerate(over[1])]
        old = watching(Branches(self.st.choices))
        try:
            point = self.flow.at(Jet.of([self.ball, 1], 2), x)
            velocity, residual, force = point.velocity(u), point.residual(u), point.force(u)
            watch = self._watched(point, u)
        finally:
            watching(old)
        V, R, F = (matrix(rows, n + m) for rows in (velocity, residual, force))
        self.du = self.dforce = self.velocity_u = self.inverse = self.force_u = 0.0
        J, D = V[:, :n], None
        try:
            if m:
                inverse = arb_mat(R[:, n:].tolist()).inv()
                S = np.array(inverse.tolist(), object)
                D = -(S @ R[:, :n])                          # du/dx
                J = V[:, :n] + V[:, n:] @ D
                self.du, self.inverse, self.velocity_u = norm(D), norm(S), norm(V[:, n:])
            if len(force):
                self.dforce = norm(F[:, :n] + F[:, n:] @ D) if m else norm(F[:, :n])
                self.force_u = norm(F[:, n:]) if m else 0.0
            self.mu = logarithmic_norm(J)
        except ZeroDivisionError:
            self.mu = float("nan")
        self.speed, self.size_u = norm(matrix_of(velocity)), norm(matrix_of(u))
        self.size_force = norm(matrix_of(force))
        self.slopes, self.by_u = {}, {}
        for key, v in watch.items():
            row = matrix([v], n + m)
            self.by_u[key] = norm(row[:, n:])
            self.slopes[key] = norm(row[:, :n] + row[:, n:] @ D) if m and D is not None else norm(row[:, :n])
        self.finite = bool(np.isfinite([self.mu, self.du, self.dforce, self.speed, *self.slopes.values()]).all())

    def wrong_sign(self, r, first, last):
        """None if everything watched is positive on the piece for all states within r, else a sentence."""
        for key, (p, rest) in self.watch.items():
            allow = float((arb(self.slopes[key]) * arb(r) + arb(self.by_u[key]) * arb(self.dw) + arb(rest)).upper())
            if positive(p, self.low, self.high, allow, depth=2) is None:
                continue
            if self._vanishes(key, p, rest):
                continue
            if (first or last) and order_of_zero([p[0]]):
                why = self._leaves_zero(key, p, first)
                if why is None:
                    continue
                return why
            s = positive(p, self.low, self.high, allow)
            if s is not None and not self._touches(key, p, allow):
                value = float(p(arb(s)).mid())
                return f"{key[0]} of {key[1]} cannot be shown to stay positive: it is {value:.3e} at t = " \
                       f"{float(self.time) + s:.12g}"
        return None

    def _vanishes(self, key, p, rest) -> bool:
        """Is the number zero all over the piece, as far as can be told?"""
        if not sum(abs(c) * arb(max(-self.low, self.high)) ** k for k, c in enumerate(p.coeffs())) + rest < ZERO:
            return False
        self.notes.append(f"{key[0]} of {key[1]} is zero throughout")
        return True

    def _touches(self, key, p, allow) -> bool:
        """Does the number come down to zero and go up again, as far as can be told? Then nothing acts: a graze."""
        s, bend = arb(0), p.derivative().derivative()
        for _ in range(20):
            s = (s - p.derivative()(s) / bend(s)).mid() if bend(s) != 0 else arb("nan")
        inside = s.is_finite() and self.low <= float(s) <= self.high
        if not (inside and abs(p(s)) + allow < ZERO and bend(ball(self.low, self.high)) > 0):
            return False
        self.notes.append(f"{key[0]} of {key[1]} touches zero at t = {float(self.time + s):.9g} without contact, to "
                          f"{ZERO:.0e},")
        return True

    def _leaves_zero(self, key, p, first):
        """A zero at the end of an arc: the first derivative that does not vanish there keeps its sign on the piece."""
        m = order_of_zero([p[k] for k in range(MULTIPLE + 1)])
        if m > MULTIPLE:
            return f"{key[0]} of {key[1]} vanishes to high order near t = {float(self.time):.12g}"
        x = [q(self.ball - self.st.t) + arb(0, TUBE) for q in self.st.x]
        x, u, _ = coefficients(self.flow, self.ball, x, m + 1, self.st.choices)
        old = watching(Branches(self.st.choices))
        try:
            point = self.flow.at(Jet.of([self.ball, 1], m + 2), [Jet.of(c[:m + 1], m + 1) for c in x])
            value = self._watched(point, [Jet.of(c, m + 1) for c in u])[key]
        finally:
            watching(old)
        if value.leading.at(m) * (1 if first or m % 2 == 0 else -1) > 0:
            return None
        return f"{key[0]} of {key[1]} leaves zero in the wrong direction near t = {float(self.time):.12g}"


def polynomial(number, count) -> arb_poly:
    return arb_poly([number.leading.at(k) for k in range(count)])


def remainder(number, k, width) -> float:
    return float((number.leading.at(k).abs_upper() * arb(width) ** k).upper())


def size(number, wide, k, width) -> arb:
    """Largest value on the piece of a Taylor polynomial with k terms and its remainder."""
    terms = sum((number.leading.at(j).abs_upper() * arb(width) ** j for j in range(k)), start=arb(0))
    return terms + wide.leading.at(k).abs_upper() * arb(width) ** k


def matrix(rows, columns) -> np.ndarray:
    """Derivatives of Duals as an object array of arb (len(rows), columns)."""
    out = np.full((len(rows), columns), arb(0), object)
    for i, v in enumerate(rows):
        v = v.v if isinstance(v, Dual) and v.level > 1 else v
        if isinstance(v, Dual):
            for j, a in v.d.items():
                out[i, j] = a.leading.at(0)
    return out


def matrix_of(values) -> np.ndarray:
    return np.array([[_lead(v)] for v in values], object).reshape(len(values), 1)


def norm(M) -> float:
    """The Frobenius norm, which bounds the 2-norm; upwards."""
    return float(sum((v.abs_upper() ** 2 for v in np.asarray(M, object).reshape(-1)), start=arb(0)).sqrt().upper())


def logarithmic_norm(J) -> float:
    """An upper bound of the largest eigenvalue of (J + J^T) / 2 for every J in the balls."""
    S = [[(J[i, j] + J[j, i]) / 2 for j in range(len(J))] for i in range(len(J))]
    mid = np.array([[float(v.mid()) for v in row] for row in S]).reshape(len(J), len(J))
    rad = np.array([[float(v.rad()) for v in row] for row in S]).reshape(len(J), len(J))
    if not (np.isfinite(mid).all() and np.isfinite(rad).all()):
        return float("nan")
    # rounding of the eigenvalues and of the matrix as floats: 1e-13 of its norm is a hundred times what LAPACK needs
    slack = 1e-13 * np.abs(mid).sum() + rad.sum(axis=1).max(initial=0.0)
    return float(np.linalg.eigvalsh(mid)[-1] + slack)
