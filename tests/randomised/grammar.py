"""Drifts from a grammar: sums of terms, written as expressions over `xp`, of the time t and the
entries of x.

Mild terms are smooth and bounded on bounded sets; wild ones are stiff, kinked, jump in time, blow
up in finite time, or stop being finite. What is written runs as it is in numpy, numba and JAX.
"""

from __future__ import annotations

from randomised.choices import Choices


def term(c: Choices, n: int, t0: float, wild: bool) -> str:
    """One term; n: number of entries of x, 0 for a function of time alone; t0: where time
    starts."""
    x = f"x[{c.below(n)}]" if n else "t"
    a = c.number(-2.0, 2.0)
    if wild and c.rarely(5):
        return _wild(c, n, x, a, t0)
    kind = c.below(9 if n else 3)
    if kind == 0:
        return f"{a}"
    if kind == 1:
        return f"{a} * xp.sin({c.number(0.5, 6.0)} * (t - {t0}) + {c.number(0.0, 3.0)})"
    if kind == 2:
        return f"{a} * (t - {t0})"
    y = f"x[{c.below(n)}]"
    return {
        3: f"{a} * {x}",
        4: f"{a} * xp.sin({c.number(0.5, 4.0)} * {x})",
        5: f"{a} * xp.tanh({x})",
        6: f"{a} * {x} / (1.0 + {y} * {y})",
        7: f"{0.3 * a:.4g} * {x} * {y}",
        8: f"-{abs(a)} * {x} * {x} * {x}",
    }[kind]


def _wild(c: Choices, n: int, x: str, a: float, t0: float) -> str:
    s = round(t0 + c.number(0.05, 2.0), 6)
    kind = c.below(9)
    stiff = c.pick((30.0, 300.0, 1e4))
    return {
        0: f"xp.where(t < {s}, {a}, {-a} + 0.5)",
        1: f"xp.minimum(xp.maximum({x}, -0.5), 0.5)",
        2: f"{a} * xp.abs({x})",
        3: f"-{stiff} * ({x} - xp.cos(t - {t0}))",
        4: f"{2.0 + abs(a)} * {x} * {x}",
        5: f"xp.exp({3.0 * abs(a):.4g} * {x})",
        6: f"xp.sqrt({s} - t)",
        7: f"{a} * xp.log({s} - t)",
        8: f"{a} / (t - {s})",
    }[kind]


def expression(c: Choices, n: int, t0: float, wild: bool = False, most: int = 3) -> str:
    """A sum of up to `most` terms."""
    return " + ".join(term(c, n, t0, wild) for _ in range(1 + c.below(most)))
