"""Scenes with switches and diodes, and smooth ones."""

from __future__ import annotations

import numpy as np

from randomised.draft import Draft, array
from randomised.grammar import expression


def smooth_ode(d: Draft, wild: bool):
    d.names.add("Complementarity")
    n = 1 + d.c.below(3)
    return (
        [d.c.number(-1.0, 1.0) for _ in range(n)],
        f"Complementarity({d.drift('drift', n, wild)})",
        "error",
    )


def _switch(d: Draft, n: int, m: int) -> str:
    c = d.c
    rows = []
    for _ in range(m):
        x = f"x[{c.below(n)}]"
        y = f"x[{c.below(n)}]"
        kinds = (
            x,
            f"{x} - {c.number(-0.5, 0.5)}",
            f"{x} - {c.number(-0.5, 0.5)} * xp.sin({c.number(0.5, 3.0)} * (t - {d.t0}))",
            f"{x} + 0.5 * {y}",
            f"{x} * {x} + {y} * {y} - 0.5",
            f"{x} * {x} * {x}",
            f"xp.sin(9.0 * {x})",
            f"t - {d.t0 + c.number(0.1, 1.0)}",
            f"{c.pick((2.0, 1e3, 1e-3))} * ({rows[0]})" if rows else x,
        )
        rows.append(c.pick(kinds))
    return d.function("switch", "t, x", rows)


def _x0(d: Draft, n: int):
    return [
        d.c.pick((0.0, 0.3, -0.2, 1e-12)) if d.c.rarely(2) else d.c.number(-1.0, 1.0)
        for _ in range(n)
    ]


def modes(d: Draft, wild: bool):
    n = 1 + d.c.below(3)
    m = 1 + d.c.below(2)
    d.names.add("Filippov")
    signs = [(1,), (-1,)] if m == 1 else [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    table = ", ".join(
        f"{s}: {d.drift('mode_' + ''.join('pm'[v < 0] for v in s), n, wild)}" for s in signs
    )
    return _x0(d, n), f"Filippov({{{table}}}, {_switch(d, n, m)})", "error"


def signs(d: Draft, wild: bool):
    c = d.c
    n = 1 + d.c.below(3)
    m = 1 + d.c.below(3)
    d.names.add("Filippov")
    rows = []
    for _ in range(n):
        s = f"s[{c.below(m)}]"
        push = (
            f"{c.number(-2.0, 2.0)} * {s}",
            f"{s} * ({expression(c, n, d.t0)})",
            f"0.5 * {s} * s[{c.below(m)}]",
        )
        rows.append(
            f"{expression(c, n, d.t0, wild)} + {c.pick(push)} + {c.number(-1.0, 1.0)} * "
            f"s[{c.below(m)}]"
        )
    field_ = d.function("field", "t, x, s", rows, d.times)
    return _x0(d, n), f"Filippov.signs({field_}, {_switch(d, n, m)})", "error"


def relay(d: Draft, wild: bool):
    c = d.c
    n = 1 + d.c.below(3)
    m = 1 + d.c.below(3)
    d.names.add("Filippov")
    B = [[c.number(-2.0, 2.0) if not c.rarely(3) else 0.0 for _ in range(m)] for _ in range(n)]
    if c.rarely(2):  # a push towards each surface
        B = [[-1.0 if i == k else 0.0 for k in range(m)] for i in range(n)]
    drift = d.drift("drift", n, wild)
    return (
        _x0(d, n),
        f"Filippov.relay({drift}, {array(d.scale * np.array(B))}, {_switch(d, n, m)})",
        "error",
    )


def circuit(d: Draft, wild: bool):
    """Linear complementarity systems: passive or not, D zero, definite, singular or skew."""
    c = d.c
    n = 1 + d.c.below(3)
    m = 1 + d.c.below(3)
    d.offset = 0.0
    d.names.add("LCS")
    square = lambda k: np.array([[c.number(-1.0, 1.0) for _ in range(k)] for _ in range(k)])
    A = square(n) - c.pick((1.0, 0.0, 100.0)) * np.eye(n)
    C = np.array([[c.number(-1.0, 1.0) for _ in range(n)] for _ in range(m)])
    B = (
        C.T
        if not c.rarely(3)
        else np.array([[c.number(-1.0, 1.0) for _ in range(m)] for _ in range(n)])
    )
    M = square(m)
    D = c.pick((np.eye(m), np.zeros((m, m)), M @ M.T, M - M.T, M, np.diag([1.0] * (m - 1) + [0.0])))
    x0 = np.array([c.number(0.0, 1.0) for _ in range(n)])
    u = d.function("u", "t", [expression(c, 0, d.t0, wild) for _ in range(n)], d.times)
    q0 = [c.number(0.0, 1.0) - (C @ x0)[k] if c.rarely(2) else 0.0 for k in range(m)]
    q = d.function(
        "q",
        "t",
        [
            f"{float(v)!r} + {c.number(-1.0, 1.0)} * xp.sin({c.number(0.5, 4.0)} * (t - {d.t0}))"
            for v in q0
        ],
        d.times,
    )
    data = ", ".join(f"np.array({M.tolist()!r})" for M in (A, B, C, D))
    return x0, f"LCS({data}, u={u}, q={q})", "error"
