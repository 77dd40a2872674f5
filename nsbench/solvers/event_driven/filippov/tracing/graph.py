"""Graph of scalar operations without duplicates, and derivatives on it.

Nodes are (op, a, b, c, d) of kernels.opcodes with a, b nodes; the first n + 1 are the state and the
time. Equal operations are one node; operations on constants are evaluated at once.
"""

from __future__ import annotations

import math

from nsbench.solvers.event_driven.filippov.kernels.opcodes import (
    ADD,
    AFFINE,
    ATAN,
    CONST,
    COS,
    COSH,
    DIV,
    EXP,
    LOG,
    MUL,
    PAIRS,
    POW,
    RDIV,
    SECH2,
    SIN,
    SINH,
    SQR,
    SUB,
    TANH,
)

INPUT = -1
# operations on the state c of kinks (tracing.kinks): node a or b; entry d of the list of tables
SELECT = -2
LOOKUP = -3
TOTAL = {
    INPUT,
    SELECT,
    LOOKUP,
    CONST,
    ADD,
    SUB,
    MUL,
    AFFINE,
    SQR,
    ATAN,
    SIN,
    COS,
    TANH,
    SECH2,
}  # finite wherever their rows are
MOST = 20_000  # nodes: beyond, the interpreter's table leaves the cache and tracing takes seconds


class Graph:
    """Operations on n states and the time (node n); its methods return the node of a result.

    times: first and last time of the run, between which periodic jumps are found. Raises TypeError
    if there are too many operations, or a constant that is not finite.
    """

    def __init__(self, n: int, times: tuple[float, float] = (0.0, 0.0)):
        self.n = n
        self.times = times
        self.nodes = []
        self.known = {}
        self.total = []
        self.kinks = []
        self.kink_numbers = {}
        self.tables = []
        for i in range(n + 1):
            self._new(INPUT, i, -1, 0.0)

    def _new(self, op, a, b, c, d=0.0):
        """Return the node of an operation, an existing one if there is an equal one."""
        key = op, a, b, c, d
        if key not in self.known:
            if len(self.nodes) >= MOST:
                raise TypeError(f"more than {MOST} operations")
            self.known[key] = len(self.nodes)
            self.nodes.append(key)
            self.total.append(
                op in TOTAL
                and (op in (INPUT, CONST, LOOKUP) or all(self.total[r] for r in (a, b) if r >= 0))
            )
        return self.known[key]

    def const(self, value: float) -> int:
        """Return the node of a constant."""
        value = float(value)
        if not math.isfinite(value):
            raise TypeError(f"the constant {value} has no series")
        return self._new(CONST, -1, -1, value + 0.0)

    def value(self, i: int) -> float | None:
        """Return the constant that node i is, or None."""
        op, _, _, c, _ = self.nodes[i]
        return c if op == CONST else None

    def constants(self, i: int) -> tuple[int | None, tuple] | None:
        """Return (k, values by the state of kink k) of a node that is constant per state.

        k is None of a constant; None: of any other node.
        """
        op, _, _, c, d = self.nodes[i]
        if op == CONST:
            return None, (c,)
        return (int(c), self.tables[int(d)]) if op == LOOKUP else None

    def lookup(self, k: int, values: tuple) -> int:
        """Return the node of a constant per state of kink k."""
        if len(set(values)) == 1:
            return self.const(values[0])
        if not all(math.isfinite(v) for v in values):
            raise TypeError("a table with an entry that is not finite has no series")
        if values not in self.tables:
            self.tables.append(values)
        return self._new(LOOKUP, -1, -1, k, self.tables.index(values))

    def select(self, k: int, rows: list[int]) -> int:
        """Return the node of rows[s] in state s of kink k; two of them, or constants."""
        picked = []
        values = []
        for s, row in enumerate(rows):
            op, a, b, c, _ = self.nodes[row]
            picked.append((a, b)[s] if op == SELECT and c == k else row)
            fixed = self.constants(picked[-1])
            if fixed is not None and fixed[0] in (None, k):
                values.append(fixed[1][s if fixed[0] == k else 0])
        if len(values) == len(rows):
            return self.lookup(k, tuple(values))
        if len(set(picked)) == 1:
            return picked[0]
        if len(picked) != 2:
            raise TypeError("a choice by the entry of a table cannot be traced")
        return self._new(SELECT, *picked, k)

    def add(self, a: int, b: int) -> int:
        """Return the node of a + b."""
        u = self.value(a)
        v = self.value(b)
        if u is not None and v is not None:
            return self.const(u + v)
        if u is not None:
            a, b, u, v = b, a, v, u
        if v is not None:
            return self._affine(a, 1.0, v)
        return self._new(ADD, min(a, b), max(a, b), 0.0)

    def _affine(self, a, c, d):
        """Return the node of c a + d, composed with `a` where that is affine itself."""
        op, inner, _, c0, d0 = self.nodes[a]
        if op == AFFINE:
            a, c, d = inner, c * c0, c * d0 + d
        if not (math.isfinite(c) and math.isfinite(d)):
            raise TypeError("a constant overflows")
        if op == LOOKUP:
            k, values = self.constants(a)
            return self.lookup(k, tuple(c * v + d for v in values))
        return a if (c, d) == (1.0, 0.0) else self._new(AFFINE, a, -1, c, d + 0.0)

    def sub(self, a: int, b: int) -> int:
        """Return the node of a - b."""
        u = self.value(a)
        v = self.value(b)
        if v is not None:
            return self.add(a, self.const(-v))
        if u is not None:
            return self.add(self.neg(b), a)
        return self.const(0.0) if a == b and self.total[a] else self._new(SUB, a, b, 0.0)

    def neg(self, a: int) -> int:
        """Return the node of -a."""
        return self.mul(a, self.const(-1.0))

    def mul(self, a: int, b: int) -> int:
        """Return the node of a b."""
        u = self.value(a)
        v = self.value(b)
        if u is not None and v is not None:
            return self.const(u * v)
        if u is not None:
            a, b, u, v = b, a, v, u
        if v is not None:
            if v == 1.0:
                return a
            return self.const(0.0) if v == 0.0 and self.total[a] else self._affine(a, v, 0.0)
        return self.square(a) if a == b else self._new(MUL, min(a, b), max(a, b), 0.0)

    def div(self, a: int, b: int) -> int:
        """Return the node of a / b; raises TypeError for a division by the constant 0.

        A division by a power of two is a multiplication.
        """
        u = self.value(a)
        v = self.value(b)
        if v is not None:
            if v == 0.0:
                raise TypeError("a division by the constant 0")
            if u is not None:
                return self.const(u / v)
            return (
                self.mul(a, self.const(1.0 / v))
                if math.frexp(v)[0] in (0.5, -0.5)
                else self._new(DIV, a, b, 0.0)
            )
        return self._new(DIV, a, b, 0.0) if u is None else self._new(RDIV, b, -1, u)

    def square(self, a: int) -> int:
        """Return the node of a^2."""
        u = self.value(a)
        return self._new(SQR, a, -1, 0.0) if u is None else self.const(u * u)

    def power(self, a: int, b: int) -> int:
        """Return the node of a^b: products for whole b up to 32, else a power or exp(b log a)."""
        v = self.value(b)
        u = self.value(a)
        if v is None:
            return self.exp(self.mul(b, self.log(a)))
        if u is not None:
            value = u**v
            if isinstance(value, complex):
                raise TypeError("a root of a negative constant")
            return self.const(value)
        if v == int(v) and abs(v) <= 32:
            k = abs(int(v))
            out = self._whole(a, k)
            return out if v >= 0 else self.div(self.const(1.0), out)
        return self._new(POW, a, -1, v)

    def _whole(self, a, k):
        """Return the node of a^k for a whole number k >= 0, by repeated squaring."""
        if k == 0:
            return self.const(1.0)
        if k == 1:
            return a
        half = self.square(self._whole(a, k // 2))
        return self.mul(half, a) if k % 2 else half

    def _function(self, op, a, f):
        """Return the node of an elementary function of a.

        Its partner, if the function is one of a pair, is the next node.
        """
        u = self.value(a)
        if u is not None:
            return self.const(f(u))
        out = self._new(op, a, a if op == LOG else -1, 0.0)
        if op in PAIRS:  # the partner is the next node
            self._new(PAIRS[op], a, -1, 0.0)
        return out

    def exp(self, a: int) -> int:
        """Return the node of exp(a)."""
        return self._function(EXP, a, math.exp)

    def log(self, a: int) -> int:
        """Return the node of log(a)."""
        return self._function(LOG, a, math.log)

    def sin(self, a: int) -> int:
        """Return the node of sin(a), followed by that of cos(a)."""
        return self._function(SIN, a, math.sin)

    def cos(self, a: int) -> int:
        """Return the node of cos(a), the partner of the sine."""
        u = self.value(a)
        return self.sin(a) + 1 if u is None else self.const(math.cos(u))

    def sinh(self, a: int) -> int:
        """Return the node of sinh(a), followed by that of cosh(a)."""
        return self._function(SINH, a, math.sinh)

    def cosh(self, a: int) -> int:
        """Return the node of cosh(a), the partner of sinh."""
        u = self.value(a)
        return self.sinh(a) + 1 if u is None else self.const(math.cosh(u))

    def tanh(self, a: int) -> int:
        """Return the node of tanh(a), followed by that of 1 / cosh(a)^2."""
        return self._function(TANH, a, math.tanh)

    def arctan(self, a: int) -> int:
        """Return the node of arctan(a), whose second operand is a^2 + 1."""
        u = self.value(a)
        return (
            self.const(math.atan(u))
            if u is not None
            else self._new(ATAN, a, self.add(self.square(a), self.const(1.0)), 0.0)
        )

    def again(self, op: int, a: int, b: int, c: float, d: float) -> int:
        """Return the node of an operation on other operands; of a pair, of the one asked for."""
        return {
            ADD: lambda: self.add(a, b),
            SUB: lambda: self.sub(a, b),
            MUL: lambda: self.mul(a, b),
            DIV: lambda: self.div(a, b),
            AFFINE: lambda: self.add(self.mul(self.const(c), a), self.const(d)),
            RDIV: lambda: self.div(self.const(c), a),
            SQR: lambda: self.square(a),
            POW: lambda: self.power(a, self.const(c)),
            EXP: lambda: self.exp(a),
            LOG: lambda: self.log(a),
            ATAN: lambda: self.arctan(a),
            SIN: lambda: self.sin(a),
            COS: lambda: self.cos(a),
            SINH: lambda: self.sinh(a),
            COSH: lambda: self.cosh(a),
            TANH: lambda: self.tanh(a),
            SECH2: lambda: self.sub(self.const(1.0), self.square(self.tanh(a))),
        }[op]()

    def derivative(self, i: int, var: int, done: dict) -> int:
        """Return the node of the derivative of node i in the input `var`.

        done: derivatives in that variable by node, extended in place.
        """
        stack = [i]
        # Forward differentiation in depth-first order, with an explicit stack.
        while stack:
            j = stack[-1]
            if j in done:
                stack.pop()
                continue
            op, a, b, _, _ = self.nodes[j]
            if op in (INPUT, CONST, LOOKUP):
                done[j] = self.const(1.0 if op == INPUT and a == var else 0.0)
                continue
            rows = [a] if b < 0 or op in (LOG, ATAN) else [a, b]
            missing = [r for r in rows if r not in done]
            stack += missing
            if not missing:
                done[j] = self._rule(j, done[a], done[b] if len(rows) > 1 else -1)
        return done[i]

    def _rule(self, y, da, db):
        """Return the derivative of node y by the rule of its operation.

        da, db: derivatives of its operands.
        """
        op, a, b, c, _ = self.nodes[y]
        if op == SELECT:
            return self.select(int(c), [da, db])
        if self.value(da) == 0.0 and (db < 0 or self.value(db) == 0.0):
            return self.const(0.0)
        if op in (ADD, SUB):
            return self.add(da, db) if op == ADD else self.sub(da, db)
        if op == MUL:
            return self.add(self.mul(da, b), self.mul(a, db))
        if op == DIV:
            return self.div(self.sub(da, self.mul(y, db)), b)
        if op == AFFINE:
            return self.mul(self.const(c), da)
        if op in (LOG, ATAN):
            return self.div(da, b)
        factor = {
            RDIV: lambda: self.neg(self.div(y, a)),
            SQR: lambda: self.mul(self.const(2.0), a),
            POW: lambda: self.mul(self.const(c), self.power(a, self.const(c - 1.0))),
            EXP: lambda: y,
            SIN: lambda: y + 1,
            COS: lambda: self.neg(y - 1),
            SINH: lambda: y + 1,
            COSH: lambda: y - 1,
            TANH: lambda: y + 1,
            SECH2: lambda: self.mul(self.const(-2.0), self.mul(y - 1, y)),
        }[op]()
        return self.mul(factor, da)
