"""A tape's series are Taylor series, its enclosures hold them, and what cannot be put on a tape is
refused."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from nsbench.compilation.decorators import python_entry
from nsbench.solvers.event_driven.filippov.kernels import enclosure, taylor_series
from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER, enclose
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.layout import lay_out
from nsbench.solvers.event_driven.filippov.tracing.trace import SPACE, inputs, vector

path = python_entry(enclosure.path)
point = python_entry(taylor_series.point)
series = python_entry(taylor_series.series)

P = 14
ELEMENTARY = {
    "add": lambda xp, u, v: u + v,
    "sub": lambda xp, u, v: u - v,
    "mul": lambda xp, u, v: u * v,
    "div": lambda xp, u, v: u / v,
    "from a constant": lambda xp, u, v: 2.0 - u,
    "scaled": lambda xp, u, v: 3.5 * u + 1.0,
    "over": lambda xp, u, v: 2.0 / u,
    "by a constant": lambda xp, u, v: u / 3.0,
    "square": lambda xp, u, v: u * u,
    "cube": lambda xp, u, v: u**3,
    "inverse": lambda xp, u, v: u**-2,
    "root": lambda xp, u, v: xp.sqrt(u),
    "power": lambda xp, u, v: u**1.7,
    "general power": lambda xp, u, v: u**v,
    "exp": lambda xp, u, v: xp.exp(u),
    "log": lambda xp, u, v: xp.log(u),
    "sin": lambda xp, u, v: xp.sin(u),
    "cos": lambda xp, u, v: xp.cos(u),
    "tan": lambda xp, u, v: xp.tan(u),
    "sinh": lambda xp, u, v: xp.sinh(u),
    "cosh": lambda xp, u, v: xp.cosh(u),
    "tanh": lambda xp, u, v: xp.tanh(u),
    "arctan": lambda xp, u, v: xp.arctan(u),
    "hypot": lambda xp, u, v: xp.hypot(u, v),
    "composed": lambda xp, u, v: xp.exp(-u * xp.sin(v)) / (1.0 + u * u),
}


class Multiple:
    """The functions above in many digits."""

    def __getattr__(self, name):
        return getattr(mpmath, {"arctan": "atan"}.get(name, name))


def u(t):
    """A path x0 of which the elementary functions are taken; x1 is its second entry."""
    return 0.7 + 0.4 * t - 0.2 * t * t + 0.1 * t**3


def v(t):
    return 0.9 - 0.3 * t + 0.15 * t * t


def tape(f):
    """Program with the states x0' = u'(t), x1' = v'(t) and output 2 the function."""
    graph = Graph(2)
    t, x = inputs(graph)
    F = vector(graph, SPACE.array([0.4 - 0.4 * t + 0.3 * t * t, -0.3 + 0.3 * t]), 2)
    return lay_out(graph, [[*F, *vector(graph, f(SPACE, x[0:1], x[1]), 1)]])


def values(made, inputs):
    """All rows at one point, computed beside others."""
    V = np.zeros((made.rows, 3))
    k = len(inputs)
    V[:k] = np.array(inputs)[:, None] + [0.1, 0.0, -0.05]
    point(made.ops, made.nums, made.first[0], k - 1, V, 3)
    return V[:, 1]


def exact(f, t, order):
    mpmath.mp.dps = 60
    c = mpmath.taylor(lambda s: f(Multiple(), u(mpmath.mpf(s)), v(mpmath.mpf(s))), t, order)
    mpmath.mp.dps = 15
    return np.array([float(k) for k in c])


@pytest.mark.parametrize("name", ELEMENTARY)
def test_coefficients_are_those_of_the_taylor_series(name):
    made = tape(ELEMENTARY[name])
    for t in (-0.3, 0.0, 0.8):
        C = np.zeros((made.rows, P + 1))
        C[:3, 0] = u(t), v(t), t
        series(made.ops, made.nums, made.first[0], made.outs[0], 2, P, C)
        want = exact(ELEMENTARY[name], t, P)
        assert np.all(
            np.abs(C[made.outs[0, 2]] - want)
            <= 2e-14 * np.maximum(np.abs(want), np.abs(want).max())
        )
        V = values(made, [u(t), v(t), t])
        assert abs(V[made.outs[0, 2]] - want[0]) <= 4e-16 * (1.0 + abs(want[0]))


@pytest.mark.parametrize("name", ELEMENTARY)
def test_enclosures_hold_every_derivative_at_every_point(name):
    made = tape(ELEMENTARY[name])
    centre = 0.4
    radius = 0.05
    Q = np.array(
        [exact(lambda xp, a, b, k=k: (a, b)[k], centre, 3) * radius ** np.arange(4) for k in (0, 1)]
    )
    M = np.zeros((made.rows, ORDER + 1))
    R = np.zeros((made.rows, ORDER + 1))
    path(Q, 2, 3, centre, radius, M, R)
    enclose(made.ops, made.nums, made.first[0], 2, M, R)
    mid = M[made.outs[0, 2]]
    rad = R[made.outs[0, 2]]
    assert np.all(np.isfinite(rad))
    for s in np.linspace(-1.0, 1.0, 5):
        want = exact(ELEMENTARY[name], centre + radius * s, ORDER) * radius ** np.arange(ORDER + 1)
        assert np.all(np.abs(mid - want) <= rad), s
    assert rad[0] < 0.2 * (1.0 + abs(mid[0])), "an enclosure this wide proves nothing"


def test_the_rounding_of_a_sum_with_a_constant_is_enclosed():
    """Against rational arithmetic: c u + d of a constant u that is small beside d."""
    draw = np.random.default_rng(3)
    for _ in range(50):
        c, small, d = draw.uniform(0.5, 2.0, 3) * (1.0, 1e-3, 1.0)
        made = tape(lambda xp, u, v, c=c, d=d: c * u + d)
        M = np.zeros((made.rows, ORDER + 1))
        R = np.zeros((made.rows, ORDER + 1))
        path(np.array([[small, 0.0], [0.0, 0.0]]), 2, 1, 0.0, 0.1, M, R)
        enclose(made.ops, made.nums, made.first[0], 2, M, R)
        row = made.outs[0, 2]
        off = abs(Fraction(c) * Fraction(small) + Fraction(d) - Fraction(M[row, 0]))
        assert 0 < off <= Fraction(R[row, 0]) < 1e-14


@pytest.mark.parametrize(
    "f",
    [
        lambda xp, u, v: xp.log(u - 0.85),
        lambda xp, u, v: 1.0 / (u - 0.85),
        lambda xp, u, v: xp.sqrt(u - 0.85),
    ],
    ids=["log", "pole", "root"],
)
def test_what_may_be_undefined_on_a_piece_is_not_enclosed(f):
    made = tape(f)
    Q = np.array([[0.85, 0.02], [0.9, 0.0]])
    M = np.zeros((made.rows, ORDER + 1))
    R = np.zeros((made.rows, ORDER + 1))
    path(Q, 2, 1, 0.0, 0.1, M, R)
    enclose(made.ops, made.nums, made.first[0], 2, M, R)
    assert not np.all(np.isfinite(R[made.outs[0, 2]]))


@pytest.mark.parametrize("name", ELEMENTARY)
def test_derivatives_are_those_of_differences(name):
    f = ELEMENTARY[name]
    graph = Graph(2)
    t, x = inputs(graph)
    (y,) = vector(graph, f(SPACE, x[0:1], x[1] + 0.1 * t), 1)
    made = lay_out(graph, [[graph.derivative(y, k, {}) for k in range(3)]])
    at = np.array([0.8, 0.6, 0.3])
    V = values(made, at)
    value = lambda z: f(np, z[0], z[1] + 0.1 * z[2])
    rough = [(value(at + e) - value(at - e)) / 2e-5 for e in 1e-5 * np.eye(3)]
    np.testing.assert_allclose(V[made.outs[0]], rough, rtol=0, atol=2e-9)


def test_arrays_are_taken_apart_while_tracing():
    graph = Graph(3)
    A = np.arange(9.0).reshape(3, 3) - 4.0
    b = np.array([0.5, 0.0, -1.0])

    def f(xp, t, x):
        y = xp.concatenate((x[:2], xp.stack((x[2], t)))).reshape(2, 2)
        return (
            A @ x
            + b
            + xp.linalg.norm(y[0]) * xp.ones_like(x)
            + xp.sum(y)
            + xp.dot(x, x) * xp.array([1.0, 0, t])
        )

    made = lay_out(graph, [vector(graph, f(SPACE, *inputs(graph)), 3)])
    x = np.array([0.3, -0.7, 1.1])
    V = values(made, [*x, 0.6])
    np.testing.assert_allclose(V[made.outs[0]], f(np, 0.6, x), rtol=1e-15)


@pytest.mark.parametrize(
    "f",
    [
        lambda xp, t, x: x if t < 1.0 else -x,
        lambda xp, t, x: xp.floor(x),
        lambda xp, t, x: xp.where(x == 0.0, x, 0.0),
        lambda xp, t, x: xp.where(x, x, 0.0),
        lambda xp, t, x: xp.array([float(x[0])]),
        lambda xp, t, x: xp.append(x, 1)[:1],
        lambda xp, t, x: xp.take(np.ones(3), x),
        lambda xp, t, x: np.nan * x,
        lambda xp, t, x: xp.array([x[0], x[0]]),
    ],
    ids=["branch", "floor", "equal", "no comparison", "float", "append", "index", "nan", "shape"],
)
def test_what_a_tape_cannot_hold_is_refused(f):
    graph = Graph(1)
    with pytest.raises((TypeError, ValueError)):
        vector(graph, f(SPACE, *inputs(graph)), 1)


def test_equal_operations_are_one():
    graph = Graph(1)
    t, x = inputs(graph)
    vector(graph, xp_sum(SPACE, x, t), 1)
    size = len(graph.nodes)
    vector(graph, xp_sum(SPACE, x, t), 1)
    assert len(graph.nodes) == size


def xp_sum(xp, x, t):
    return xp.sin(x * t) + xp.cos(t * x) * xp.sin(x * t)
