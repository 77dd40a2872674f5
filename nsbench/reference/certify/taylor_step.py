"""One Taylor step of a flow: series of state, unknowns, impulses and reaction about its start."""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb, arb_poly

from nsbench.reference.certify.array_namespace import Branches, NotDecided, watching
from nsbench.reference.certify.ball_algebra import solve
from nsbench.reference.certify.ball_series import Jet, Number

NEWTON = 60  # of a root: quadratic, from a guess good to 1e-9


@dataclass(frozen=True, eq=False)
class Step:
    """Hold a piece of the solution: series about time t (arb), used on [t, t + h].

    x (n), u (unknowns), impulse, reaction: arb_poly in s = time - t; impulse and reaction count
    from the step's start. choices: sides of the kinks of the drift; deciders: polynomials that keep
    their signs on the step.
    """

    t: arb
    h: arb
    x: list
    u: list
    impulse: list
    reaction: list
    watch: dict
    choices: list
    deciders: list

    def state(self, time: arb) -> list:
        return [p(time - self.t).mid() for p in self.x]


def coefficients(flow, t: arb, x0: list, order: int, choices=None):
    """Compute the series of state (order + 1 coefficients) and unknowns (order), and the choices at
    the kinks of the drift.

    Coefficient k of the unknowns makes coefficient k of the residual vanish; the residual is affine
    in it with the matrix of its leading coefficients. One evaluation of the flow per order.
    """
    branches = Branches(choices)
    old = watching(branches)
    try:
        x = [[v] for v in x0]
        u = []
        matrix = None
        for L in range(1, order + 1):
            branches.deciders = []
            point = flow.at(Jet.of([t, 1], L + 1), [Jet.of(c, L) for c in x])
            if L == 1:
                u = [[v] for v in point.start()]
                matrix = point.matrix([Jet.of(c, 1) for c in u]) if flow.m else None
            elif flow.m:
                r = point.residual([Jet.of(c, L) for c in u])
                for c, v in zip(u, solve(matrix, [-a.leading.at(L - 1) for a in r]), strict=True):
                    c.append(v)
            v = point.velocity([Jet.of(c, L) for c in u])
            for c, a in zip(x, v, strict=True):
                c.append(a.leading.at(L - 1) / L)
            branches.fixed = True
    finally:
        watching(old)
    return x, u, branches.choices


def step(flow, t: arb, x0: list, order: int, digits: float, most: arb, choices=None) -> Step:
    """Make the step from x0 with truncation below 10^-digits of the size of the state; at most
    `most` long.
    """
    x, u, choices = coefficients(flow, t, x0, order, choices)
    mid = lambda rows: [[v.mid() for v in c] for c in rows]
    x = mid(x)
    u = mid(u)
    branches = Branches(choices)
    old = watching(branches)
    try:
        point = flow.at(Jet.of([t, 1], order + 1), [Jet.of(c[:order], order) for c in x])
        jets = [Jet.of(c, order) for c in u]
        watch = {k: polynomial(v) for k, v in point.watch(jets).items()}
        impulse = [polynomial(v, integrate=True) for v in point.rates_of_impulse(jets)]
        reaction = [polynomial(v, integrate=True) for v in point.force(jets)]
    finally:
        watching(old)
    deciders = [polynomial(j) for j in branches.deciders]
    watched = [[p[k] for k in range(order)] for p in [*watch.values(), *deciders]]
    h = min(
        float(most),
        length(x, order, digits),
        length(watched, order - 1, digits) if watched else float("inf"),
    )
    return Step(
        t,
        arb(h) if h < float(most) else most,
        [arb_poly(c) for c in x],
        [arb_poly(c) for c in u],
        impulse,
        reaction,
        watch,
        choices,
        deciders,
    )


def polynomial(number: Number, integrate: bool = False) -> arb_poly:
    jet = number.leading
    jet = jet.integral() if integrate else jet
    return arb_poly([jet.at(k).mid() for k in range(min(jet.length, 200))])


def length(x: list, order: int, digits: int) -> float:
    """Choose the step whose last two terms are below 10^-digits of 1 + the largest coordinate.

    Source: Jorba and Zou, Experimental Mathematics 14 (2005), section 3.2.
    """
    size = 1.0 + max(abs(float(c[0])) for c in x)
    out = float("inf")
    for k in (order - 1, order):
        worst = max(abs(float(c[k])) for c in x) / size
        if worst > 0.0:
            out = min(out, (10.0**-digits / worst) ** (1.0 / k))
    return out


def root(p: arb_poly, guess: arb, reach: float) -> arb | None:
    """Find the zero of a polynomial near `guess` by Newton's method; None if it leaves the reach or
    does not settle.
    """
    slope = p.derivative()
    s = guess.mid()
    for _ in range(NEWTON):
        d = slope(s).mid()
        if d == 0:
            return None
        move = (p(s).mid() / d).mid()
        s = (s - move).mid()
        if abs(float(s - guess)) > reach:
            return None
        if abs(float(move)) <= 1e-45 * (1.0 + abs(float(s))):
            return s
    return None


def first_kink(step: Step, h: float, pieces: int = 24) -> arb | None:
    """Find the earliest time in (0, h] at which a decider changes its sign against its choice; None
    if none does.
    """
    found = None
    for choice, p in zip(step.choices, step.deciders, strict=True):
        sign = 1 if choice else -1
        values = [sign * float(p(arb(h) * k / pieces).mid()) for k in range(pieces + 1)]
        for k in range(1, pieces + 1):
            if values[k] < 0.0:
                low = arb(h) * (k - 1) / pieces
                high = arb(h) * k / pieces
                for _ in range(40):
                    mid = ((low + high) / 2).mid()
                    low, high = (low, mid) if sign * float(p(mid).mid()) < 0 else (mid, high)
                s = root(p, high, h)
                found = s if s is not None and (found is None or s < found) else found
                break
    return found


__all__ = [
    "NotDecided",
    "Step",
    "coefficients",
    "first_kink",
    "length",
    "polynomial",
    "root",
    "step",
]
