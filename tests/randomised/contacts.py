"""Scenes with contacts: rows, hard particles, links and anchors, curved walls."""

from __future__ import annotations

import numpy as np

from randomised.choices import Choices
from randomised.draft import Draft, array


# ---------------------------------------------------------------- rows
def _rows(c: Choices, n: int, most: int):
    """Gradients, with duplicates, opposites and sums among them."""
    rows = []
    for _ in range(1 + c.below(most)):
        kind = c.below(6) if rows else c.below(2)
        if kind == 0:
            a = np.zeros(n)
            a[c.below(n)] = c.pick((1.0, -1.0))
        elif kind == 1:
            a = np.array([c.number(-1.0, 1.0) for _ in range(n)])
            a = a if np.abs(a).max() > 0.05 else np.ones(n)
        elif kind == 5 and len(rows) > 1:
            a = rows[0] + rows[1]
        else:
            a = c.pick(rows) * {2: 1.0, 3: -1.0, 4: c.pick((2.0, 1e-3, 1e3)), 5: 0.5}[kind]
        rows.append(a if np.abs(a).max() > 1e-9 else np.eye(n)[0])
    return rows


SLACKS = (0.5, 0.0, 0.2, 1.0, 1e-9, 1e-13, 0.05, -0.2)


def _slack(c: Choices, rarely_infeasible: bool = True) -> float:
    s = c.pick(SLACKS)
    return 0.0 if s < 0 and rarely_infeasible and not c.rarely(3) else s


def _start(d: Draft, slacks) -> str:
    if min(slacks) > -1e-12:
        return "error"
    d.note("infeasible start")
    return d.c.pick(("project", "keep", "project", "error"))


def _affine(d: Draft, rows, slacks, x0, name="b", may_move=True) -> str:
    """A family of rows with these slacks at the start; walls that move keep them there."""
    c = d.c
    d.names.add("Affine")
    A = np.array(rows)
    # g = a (x - offset) / scale + own  in the units of the scene, times the scale
    b = d.scale * (np.array(slacks) - A @ x0) - A @ np.full(len(x0), d.offset)
    if not (may_move and c.rarely(3)):
        return f"Affine(np.array({A.tolist()!r}), {array(b)})"
    d.note("moving walls")
    moves = []
    for v in b:
        a = c.number(-1.0, 1.0)
        w = c.number(0.5, 4.0)
        p = c.number(0.0, 3.0)
        kind = c.below(3)
        move = (
            f"{a} * (xp.sin({w} * (t - {d.t0}) + {p}) - {np.sin(p)!r})",
            f"{a} * (t - {d.t0})",
            f"xp.where(t < {d.t0 + w / 4:.6g}, 0.0, {a} * (t - {d.t0 + w / 4:.6g}))",
        )[kind]
        moves.append(f"{float(v)!r} + {d.times}({move})")
    d.parts.append(
        f"def {name}(xp):\n    def f(t):\n        return xp.array([{', '.join(moves)}])\n    "
        f"return f\n"
    )
    return f"Affine(np.array({A.tolist()!r}), {name})"


def affine(d: Draft, wild: bool):
    c = d.c
    n = d.c.below(3) + 1
    x0 = np.array([c.number(-1.0, 1.0) for _ in range(n)])
    rows = _rows(c, n, 5)
    slacks = [_slack(c) for _ in rows]
    d.names.add("Complementarity")
    cut = c.below(len(rows)) if c.rarely(4) else 0
    families = [_affine(d, rows[cut:], slacks[cut:], x0)]
    if cut:
        families.insert(0, _affine(d, rows[:cut], slacks[:cut], x0, "b2"))
    return (
        x0,
        f"Complementarity({d.drift('drift', n, wild)}, ({', '.join(families)},))",
        _start(d, slacks),
    )


# ---------------------------------------------------------------- particles
def discs(d: Draft, wild: bool):
    """Hard particles in 1 to 3 dimensions, touching, overlapping or coincident, with walls and a
    second family."""
    c = d.c
    dim = d.c.pick((2, 1, 3))
    N = 1 + d.c.below(6)
    x0 = _places(c, N, dim)
    start = "error"
    if N > 1 and c.rarely(5):
        at = c.pick(("coincident", "close", "overlap"))
        d.note(at)
        x0[1] = x0[0] + np.eye(dim)[0] * {"coincident": 0.0, "close": 1e-300, "overlap": 0.6}[at]
        start = c.pick(("project", "keep", "error"))
    d.names |= {"Complementarity", "Distance"}
    if c.rarely(3):
        size = f"radii={array([d.scale * v for v in [0.5, *(0.5 - 0.1 * c.below(4) for _ in range(N - 1))]])}"
    else:
        size = f"d={d.scale!r}"
    families = [f"Distance({size}, dim={dim})"]
    if c.rarely(5):
        families.append(families[0])
        d.note("duplicate family")
    if not c.rarely(3):
        n = N * dim
        half = float(np.abs(x0).max()) + c.pick((0.3, 0.0, 1.0))
        rows = [*np.eye(n), *-np.eye(n)]
        families.append(
            _affine(d, rows, [half - a @ x0.ravel() for a in -np.array(rows)], x0.ravel())
        )
    drift = d.drift("drift", N * dim, wild, _attraction(c, x0))
    return x0.ravel(), f"Complementarity({drift}, ({', '.join(families)},))", start


def _places(c: Choices, N: int, dim: int):
    """(N, dim) centres of particles of diameter 1 on a lattice around 0, some of them touching
    exactly."""
    gap = c.pick((0.3, 0.0, 0.05, 1e-9))
    side = N if c.rarely(2) else int(np.ceil(N ** (1 / dim)))
    at = np.array([np.unravel_index(k, (side,) * dim) for k in range(N)], float)
    if dim == 2 and c.rarely(3):  # triangular
        at = np.stack((at[:, 0] + 0.5 * (at[:, 1] % 2), np.sqrt(3) / 2 * at[:, 1]), axis=1) * (
            1 + 1e-15
        )
    return (at - at.mean(axis=0)) * (1.0 + gap)


def _attraction(c: Choices, x0):
    """Terms that pull everything together, or nothing."""
    pull = c.pick((0.0, 1.0, 1.0, 0.4))
    return [f"-{pull} * x[{k}]" if pull else "" for k in range(x0.size)]


def links(d: Draft, wild: bool):
    """A chain of links of maximal length, rods (both signs), with still or moving anchors."""
    c = d.c
    dim = d.c.pick((2, 1, 3))
    N = 1 + d.c.below(4)
    x0 = np.zeros((N, dim))
    x0[:, 0] = np.arange(N) * c.pick((1.0, 0.7, 1e-3))
    if dim > 1:
        x0[:, 1] = [c.number(-0.5, 0.5) for _ in range(N)]
    d.names |= {"Complementarity", "Distance"}
    families = []
    slacks = [0.0]
    if N > 1:
        length = np.linalg.norm(np.diff(x0, axis=0), axis=1)
        slack = [_slack(c) for _ in length]
        pairs = [[k, k + 1] for k in range(N - 1)]
        slacks += slack
        long = np.maximum(length + slack, 1e-3)
        families.append(f"Distance(d={array(d.scale * long)}, sign=-1, pairs={pairs}, dim={dim})")
        if c.rarely(4):
            d.note("rods")
            families.append(
                f"Distance(d={array(d.scale * long)}, sign=1, pairs={pairs}, dim={dim})"
            )
            slacks += [-s for s in slack]
    for name in ("anchor", "second")[: 1 + c.below(2)]:
        slacks.append(_anchor(d, name, x0, dim, families))
    return (
        x0.ravel(),
        f"Complementarity({d.drift('drift', N * dim, wild)}, ({', '.join(families)},))",
        _start(d, slacks),
    )


def _anchor(d: Draft, name, x0, dim, families) -> float:
    """An anchor for the last particle, an obstacle or a tether; its slack."""
    c = d.c
    sign = d.c.pick((-1, 1))
    away = np.array([c.number(-1.0, 1.0) for _ in range(dim)])
    away = away if np.linalg.norm(away) > 0.1 else np.eye(dim)[0]
    at = x0[-1] + away
    slack = _slack(c)
    length = max(np.linalg.norm(away) + (slack if sign < 0 else -slack), 1e-3)
    place = [f"{float(d.offset + d.scale * v)!r}" for v in at]
    pairs = [[len(x0) - 1, 0]]
    if c.rarely(2):
        d.note("moving anchor")
        w = c.number(0.5, 3.0)
        place[0] += f" + {d.times}{c.number(-1.0, 1.0)} * xp.sin({w} * (t - {d.t0}))"
        d.parts.append(
            f"def {name}(xp):\n    def f(t):\n        return xp.array([[{', '.join(place)}]])\n   "
            f" return f\n"
        )
        where = name
    else:
        where = f"np.array([[{', '.join(place)}]])"
    families.append(
        f"Distance(d={float(d.scale * length)!r}, sign={sign}, pairs={pairs}, anchors={where}, "
        f"dim={dim})"
    )
    return slack


def smooth_gaps(d: Draft, wild: bool):
    """Curved walls, moving ones, and some whose gradient vanishes where they are met."""
    c = d.c
    n = 2
    x0 = np.array([c.number(-0.6, 0.6), c.number(-0.6, 0.6)])
    d.names |= {"Complementarity", "Smooth"}
    move = (
        f" + {c.number(-0.4, 0.4)} * xp.sin({c.number(0.5, 3.0)} * (t - {d.t0}))"
        if c.rarely(2)
        else ""
    )
    kinds = (
        f"1.0 - x[0] ** 2 - x[1] ** 2{move}",
        f"1.2 - xp.sqrt(x[0] ** 2 + 2.0 * x[1] ** 2 + 0.01){move}",
        f"x[1] - x[0] ** 2 + 1.0{move}",
        f"0.8 - x[0]{move}",
        "x[0] ** 2 + x[1] ** 2",
        f"x[1] + 0.7 - 0.2 * xp.sin(3.0 * x[0]){move}",
        "(x[0] + 0.7) ** 3",
        f"(x[0] - 1.5) ** 2 + x[1] ** 2 - 0.25{move}",
    )
    rows = [c.pick(kinds) for _ in range(1 + c.below(3))]
    g = d.function("g", "t, x", rows, d.times)
    families = [f"Smooth({g})"]
    if c.rarely(3):
        families.append(_affine(d, np.eye(2)[:1], [_slack(c)], x0))
    return (
        x0,
        f"Complementarity({d.drift('drift', n, wild)}, ({', '.join(families)},))",
        c.pick(("project", "keep")),
    )
