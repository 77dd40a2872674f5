"""Models of cases for nosnoc: Filippov systems in Stewart's form, constraints in step form.

The step form has a Heaviside function of each gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Affine, Complementarity, Distance, Filippov

MOST = 10  # contacts: from six on (four discs), steps were seen to fail or to be wrong


def untold_fields(case: Case) -> str | None:
    """Explain why a Filippov system has no equivalent in Stewart's form; None if it has one.

    That form needs the fields of all 2^d modes and mixes them convexly: it takes at most two
    surfaces, and fields that are affine in the signs of two.
    """
    p = case.problem
    d = len(as_numpy(p.switch)(float(case.t[0]), case.x0.copy()))
    if d > 2:
        return (
            f"Stewart's form needs all 2^d fields; this case has {d} surfaces, at most two are "
            f"taken."
        )
    f = as_numpy(p.field)
    twist = (
        sum(
            a * b * f(float(case.t[0]), case.x0.copy(), np.array([a, b]))
            for a, b in product((1.0, -1.0), repeat=2)
        )
        if d == 2
        else np.zeros(1)
    )
    if np.abs(twist).max() > 1e-12:
        return (
            "Stewart's form is another system where the field is not affine in the signs of "
            "two surfaces."
        )
    return None


def untold_contacts(case: Case) -> str | None:
    """Explain why the constraints of a case cannot be modelled for nosnoc; None if they can."""
    p = case.problem
    if not p.constraints:
        return "nosnoc is for systems that switch; this case has neither constraints nor surfaces."
    if case.start != "error":
        return f'nosnoc starts on the feasible set; this case has start="{case.start}".'
    if not all(isinstance(c, (Affine, Distance)) for c in p.constraints):
        return "nosnoc is given affine constraints and distances here; this case has others."
    m = sum(count(c, case.n) for c in p.constraints)
    return (
        f"Every step would be a program with all {m} contacts; more than {MOST} are not taken."
        if m > MOST
        else None
    )


def count(c: Affine | Distance, n: int) -> int:
    """Count the constraints of a family in a state of size n."""
    if isinstance(c, Affine):
        return c.shape[0]
    many = c.particles(n)
    if c.pairs is not None:
        return len(c.pairs)
    if c.anchors is None:
        return many * (many - 1) // 2
    return many * np.shape(as_numpy(c.anchors)(0.0) if c.moving else c.anchors)[0]


def model(case: Case, push: float) -> tuple:
    """Build the nosnoc model of a case.

    The states are x, time, and the integrals of the multipliers; then the reaction, if gradients
    turn. Constraints act as a drift push (1 - alpha) grad g, with alpha the step function of the
    gap.

    Returns the NosnocModel, the contact ids, and whether the reaction is integrated.
    """
    import casadi as ca
    import nosnoc

    from nsbench.solvers.nosnoc.casadi_namespace import Namespace, column, vector

    p = case.problem
    n = case.n
    xp = Namespace()
    t0 = float(case.t[0])
    x = ca.SX.sym("x", n)
    t = ca.SX.sym("t")
    X = vector(x)
    T = vector(t)[0]
    if isinstance(p, Filippov):
        f = p.field(xp)
        c = column(p.switch(xp)(T, X))
        d = c.shape[0]
        modes = np.array(list(product((1.0, -1.0), repeat=d)))
        w = ca.SX.sym("w", d)
        # Stewart's form: the fields of all 2^d modes as columns, with the weights of the positive
        # sides.
        F = ca.horzcat(*(ca.vertcat(column(f(T, X, s)), 1.0, *(0.5 * (1.0 + s))) for s in modes))
        x0 = np.concatenate((case.x0, [t0], np.zeros(d)))
        return (
            nosnoc.NosnocModel(x=ca.vertcat(x, t, w), x0=x0, F=[F], c=[c], S=[modes]),
            tuple((0, i) for i in range(d)),
            False,
        )
    ids, values = zip(*gaps(p, X, T, xp, n), strict=True)
    g = column(list(values))
    m = len(ids)
    turning = any(isinstance(c, Distance) for c in p.constraints)
    alpha = ca.SX.sym("alpha", m)
    w = ca.SX.sym("w", m)
    r = ca.SX.sym("r", n if turning else 0)
    # Heaviside step form: alpha is 1 where g > 0, and between 0 and 1 on g = 0.
    lam = push * (1.0 - alpha)
    force = ca.jacobian(g, x).T @ lam
    rhs = ca.vertcat(column(p.drift(xp)(T, X)) + force, 1.0, lam, force if turning else r)
    x0 = np.concatenate((case.x0, [t0], np.zeros(m + r.shape[0])))
    return (
        nosnoc.NosnocModel(x=ca.vertcat(x, t, w, r), x0=x0, f_x=[rhs], alpha=[alpha], c=[g]),
        ids,
        turning,
    )


def gaps(problem: Complementarity, x, t, xp, n: int) -> Iterator[tuple]:
    """Yield (id, CasADi expression of the gap) of every constraint.

    x (n,), t: symbols; xp: the CasADi namespace.
    """
    for k, c in enumerate(problem.constraints):
        if isinstance(c, Affine):
            A = dense(c)
            b = c.b(xp)(t) if c.moving else c.b
            yield from (((k, i), A[i] @ x + b[i]) for i in range(len(A)))
            continue
        many = c.particles(n)
        P = x[c.start : c.start + many * c.dim].reshape(many, c.dim)
        anchors = None if c.anchors is None else (c.anchors(xp)(t) if c.moving else c.anchors)
        pairs = (
            c.pairs
            if c.pairs is not None
            else (
                np.stack(np.triu_indices(many, 1), 1)
                if anchors is None
                else np.stack(
                    np.meshgrid(np.arange(many), np.arange(len(anchors)), indexing="ij"), -1
                ).reshape(-1, 2)
            )
        )
        for e, (i, j) in enumerate(pairs):
            u = P[i] - (P[j] if anchors is None else anchors[j])
            d = c.radii[i] + c.radii[j] if c.d is None else c.d[e] if c.d.ndim else float(c.d)
            yield (k, int(i), int(j)), c.sign * (xp.sqrt(sum(v * v for v in u)) - d)


def dense(c: Affine) -> np.ndarray:
    """Return the matrix A (m, n) of an affine family as a dense array."""
    A = np.zeros(c.shape)
    A[np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)), c.indices] = c.data
    return A
