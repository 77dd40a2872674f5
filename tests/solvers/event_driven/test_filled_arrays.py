"""Drifts that fill an array entry by entry are traced as the same drift written with xp.stack: by
event_driven, in interval Taylor series and in JAX; what is written where is numpy's."""

import jax
import numpy as np
import pytest

from nsbench import Affine, Case, Complementarity, Distance, Filippov
from nsbench.compilation.user_forms.draft_array import Draft, DraftNamespace
from nsbench.compilation.factories import as_jax
from nsbench.dynamics.interval_taylor import SPACE as JETS
from nsbench.dynamics.interval_taylor import as_jet, enclosing
from nsbench.solvers import solve
from nsbench.solvers.event_driven.contacts.drift_program import trace_drift
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.trace import SPACE as TRACES
from nsbench.solvers.event_driven.filippov.tracing.trace import inputs, vector


def by_entries(xp, t, x):
    out = xp.zeros(4)
    out[0] = x[1]
    out[1:] = -x[:3]
    out[-1] += 2.0 * t
    out *= 2.0
    return out


def in_views(xp, t, x):
    out = xp.empty(4)
    p = out.reshape((2, 2))
    p[:, 0] = x[:2]
    p.T[1] = [x[2], x[3]]
    middle = out[1:3]
    middle += 1.0
    xp.ravel(middle)[0] = middle[1] * t
    return out


def by_two_names(xp, t, x):
    out = xp.ones_like(x)
    other = out
    other[0] = x[3]
    before = out * 3.0
    other *= x
    number = out[2]
    number += 1.0
    out[1] = number
    out.fill(out[1] + before[0] + out[3])
    return out


def in_two_dimensions(xp, t, x):
    out = xp.zeros((2, 2))
    for i in range(2):
        out[i, 0] = x[i]
        out[i, 1] = -x[2 + i] * t
    column = out[:, 1].copy()
    column[0] = 9.0
    return out.flatten() + xp.concatenate([out @ x[:2], column])


def from_constants(xp, t, x):
    out = xp.array([0.0, 1.0, 2.0, 3.0])
    out[[3, 1]] = x[:2]
    table = xp.asarray([[1.0, 2.0], [3.0, 4.0]])
    d = xp.full(2, t)
    d[1] = xp.sum(out)
    out[2:] = table @ d + xp.full_like(d, x[0])
    out[1:] = out[:-1]
    return out


def from_copies(xp, t, x):
    y = xp.copy(x)
    part = y[1:3]
    part[0] = x[0]
    y[2] += t
    z = xp.empty_like(x)
    z[...] = xp.where(x > 0.5, y, xp.zeros(4)) * y
    return z + xp.maximum(z, y) - xp.linalg.norm(y)


FORMS = [by_entries, in_views, by_two_names, in_two_dimensions, from_constants, from_copies]
STACKED = {
    by_entries: lambda xp, t, x: [
        2.0 * x[1],
        -2.0 * x[0],
        -2.0 * x[1],
        (-x[2] + 2.0 * t) * 2.0,
    ],
    in_views: lambda xp, t, x: [x[0], (x[1] + 1.0) * t, x[1] + 1.0, x[3]],
    by_two_names: lambda xp, t, x: [x[2] + 1.0 + x[3] * 3.0 + x[3]] * 4,
}


def of_methods(xp, t, x):
    """What is no Draft: a method's copy of the state, and the result of an expression."""
    y = x.copy()
    y[1:3][0] = x[0]
    y.reshape((2, 2))[:, 1] = t
    w = -x
    u = w.T
    u[1] = 7.0
    w[0] = 0.0
    return y + w + u + x


@pytest.mark.parametrize("form", [*FORMS, of_methods], ids=lambda f: f.__name__)
def test_interval_series_hold_what_numpy_computes(form):
    x = np.array([0.3, 0.8, -0.4, 1.2])
    found = as_jet(form(JETS, as_jet(np.float64(0.7), 3), as_jet(x, 3)), 3)
    off = np.abs(found.mid[..., 0] - form(np, 0.7, x.copy())[:, None])
    assert np.all(off <= found.rad[..., 0]) and found.rad.max() < 1e-12


def test_a_write_into_the_negative_leaves_the_radii_of_the_enclosure():
    x = enclosing(np.zeros((2, 1)), np.ones((2, 1)))
    w = -x
    w[0] = 0.0
    assert np.all(x.rad[..., 0] >= 1.0) and w.rad[0].max() == 0.0


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f.__name__)
def test_jax_computes_what_numpy_computes(form):
    x = np.array([0.3, 0.8, -0.4, 1.2])
    f = as_jax(lambda xp: lambda t, x: form(xp, t, x))
    assert np.allclose(jax.jit(f)(0.7, x), form(np, 0.7, x.copy()), rtol=1e-15, atol=1e-15)
    assert jax.jacfwd(f, 1)(0.7, x).shape == (4, 4)


@pytest.mark.parametrize("form", [*FORMS, of_methods], ids=lambda f: f.__name__)
def test_traced_operations_compute_what_numpy_computes(form):
    problem = Complementarity(lambda xp: lambda t, x: form(xp, t, x))
    case = Case("f", problem, np.array([0.3, 0.8, -0.4, 1.2]), np.linspace(0.0, 0.01, 2))
    traj = solve(case, "event_driven")
    assert traj.stats["unproven"] == 0 and "cannot" not in str(traj.stats)
    graph = Graph(4)
    nodes = vector(graph, form(TRACES, *inputs(graph)), 4)
    if form in STACKED:
        assert nodes == vector(graph, STACKED[form](TRACES, *inputs(graph)), 4)


def oscillator(push, filled):
    """x'' = -x + cos 3 t + push."""

    def drift(xp):
        def f(t, x):
            if not filled:
                return xp.stack([x[1], -x[0] + xp.cos(3.0 * t) + push])
            out = xp.zeros(2)
            out[0] = x[1]
            out[1:] = -x[:1]
            out[-1] += xp.cos(3.0 * t)
            out[1] += push
            return out

        return f

    return drift


def switch(xp):
    def c(t, x):
        out = xp.empty(1)
        out[0] = x[1]
        return out

    return c


def wave(filled):
    """Four coordinates, two of them cubic."""

    def drift(xp):
        def f(t, x):
            if not filled:
                return xp.stack([-x[0] + xp.sin(t), -(x[1] ** 3), -x[2], -(x[3] ** 3)])
            out = xp.zeros_like(x)
            out[::2] = -x[::2]
            out[1::2] = -(x[1::2] ** 3)
            out[0] += xp.sin(t)
            return out

        return f

    return drift


def friction(filled):
    sides = {(1,): oscillator(-0.4, filled), (-1,): oscillator(0.4, filled)}
    return Filippov(sides, switch if filled else lambda xp: lambda t, x: x[1:])


def free(filled):
    return Complementarity(oscillator(0.0, filled))


def contacts(filled):
    return Complementarity(wave(filled), (Distance(d=1.0), Affine(np.eye(4)[1::2], [0.5, 0.5])))


@pytest.mark.parametrize("make", [friction, free, contacts])
def test_runs_are_those_of_the_stacked_drift(make):
    x0 = np.array([1.0, 0.3, -1.0, 0.1])[: 4 if make is contacts else 2]
    runs = [
        solve(Case("f", make(filled), x0, np.linspace(0.0, 5.0, 11)), "event_driven")
        for filled in (True, False)
    ]
    for traj in runs:
        assert traj.status.ok and traj.stats["loop"] == "compiled"
        assert traj.stats["roots"] == "verified" and traj.stats["unproven"] == 0
    assert np.array_equal(runs[0].x, runs[1].x)


@pytest.mark.long
@pytest.mark.parametrize(("method", "steps"), [("penalty", {}), ("pbd_jax", {"h": 1e-2})])
def test_jax_methods_run_filled_drifts(method, steps):
    x0 = np.array([1.0, 0.3, -1.0, 0.1])
    runs = [
        solve(Case("f", contacts(filled), x0, np.linspace(0.0, 0.2, 3)), method, **steps)
        for filled in (True, False)
    ]
    assert runs[0].status.ok and np.array_equal(runs[0].x, runs[1].x)


def branches(xp, t, x):
    out = xp.zeros(2)
    if x[0] > 0.0:
        out[0] = 1.0
    return out


def unwritten(xp, t, x):
    out = xp.empty(2)
    out[0] = x[0]
    return out


def sorts(xp, t, x):
    out = xp.zeros(2)
    out[:] = x
    out.sort()
    return out


def puts(xp, t, x):
    out = xp.zeros(2)
    xp.copyto(out, x)
    return out


def adds_at(xp, t, x):
    out = xp.zeros(2)
    xp.add.at(out, [0, 0], x)
    return out


def looks_up(xp, t, x):
    out = xp.zeros(2)
    out[xp.searchsorted(np.array([0.0, 1.0]), t)] = x[0]
    return out


REFUSED = {
    branches: "write xp.where",
    unwritten: "before it is written",
    sorts: "write out",
    puts: "write out",
    adds_at: "write out",
    looks_up: "an index",
}


@pytest.mark.parametrize("form", REFUSED, ids=lambda f: f.__name__)
def test_what_is_not_traced_is_refused_with_its_line(form):
    problem = Complementarity(lambda xp: lambda t, x: form(xp, t, x))
    case = Case("f", problem, np.array([1.0, 0.0]), np.linspace(0.0, 1.0, 2))
    said = trace_drift(case, needs_kinks=False)[1]
    assert REFUSED[form] in said
    assert form is unwritten or " of test_filled_arrays.py: " in said


@pytest.mark.parametrize("name", ["zeros", "ones", "empty", "full"])
def test_other_types_of_numbers_and_attributes_are_the_namespace_s(name):
    for xp, plain in ((TRACES, np), (DraftNamespace(jax.numpy), jax.numpy)):
        values = (2.0,) if name == "full" else ()
        assert isinstance(getattr(xp, name)(3, *values), Draft)
        other = getattr(xp, name)(3, *values, dtype=int)
        assert other.dtype == getattr(plain, name)(3, *values, dtype=int).dtype
        assert xp.__name__ == plain.__name__
