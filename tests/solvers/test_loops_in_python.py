"""A loop that runs in Python says so in its note, with the reason; a compiled one has none."""

import inspect

import numpy as np
import pytest

from nsbench import LCS, Affine, Case, Complementarity, Filippov, Hybrid, Smooth, Transition, solve

T = np.linspace(0.0, 0.2, 3)
STIFFNESS = {"k": 2.0}


def untyped(xp):
    def f(t, x):
        return xp.ones_like(x) * -STIFFNESS["k"]

    return f


def plain(xp):
    return lambda t, x: -2.0 * xp.ones_like(x)


def first(xp):
    return lambda t, x: x[:1]


def scenes(drift):
    """A case for each method with a compiled loop."""
    wall = Affine(np.array([[1.0]]), np.zeros(1))
    contact = Case("contact", Complementarity(drift, (wall,)), np.array([0.3]), T)
    relay = Case("relay", Filippov({+1: drift, -1: plain}, first), np.array([0.3]), T)
    contacts = ("pbd", "catching_up", "theta")
    return [*((m, contact) for m in contacts), ("euler", relay), ("euler[implicit=true]", relay)]


@pytest.mark.parametrize(("method", "case"), scenes(untyped))
def test_the_note_names_the_line_that_is_not_compiled(method, case):
    traj = solve(case, method, h=0.05)
    line = inspect.getsourcelines(untyped)[1] + 2
    assert traj.status.ok and traj.stats["loop"] == "host"
    assert traj.stats["note"].startswith("The loop ran in Python, which is slower: numba cannot")
    assert f"line {line}" in traj.stats["note"]


@pytest.mark.parametrize(("method", "case"), scenes(plain))
def test_a_compiled_loop_has_no_note(method, case):
    traj = solve(case, method, h=0.05)
    assert traj.stats["loop"] == "compiled" and "note" not in traj.stats


def curved() -> Case:
    gap = Smooth(lambda xp: lambda t, x: xp.stack([x[0] + 1.0 + x[0] ** 2]))
    return Case("curved", Complementarity(plain, (gap,)), np.array([0.3]), T)


def alternating() -> Case:
    modes = {"a": plain, "b": lambda xp: lambda t, x: 2.0 * xp.ones_like(x)}
    below = Transition("a", lambda xp: lambda t, x: 0.1 - x[0], "b")
    return Case("alternating", Hybrid(modes, (below,)), np.array([0.3]), T)


def circuit() -> Case:
    one = np.array([[1.0]])
    return Case("circuit", LCS(-one, one, one, one), np.array([0.3]), T)


@pytest.mark.parametrize(
    ("method", "case", "word"),
    [
        ("pbd", curved(), "Newton"),
        ("catching_up", curved(), "linearised"),
        ("catching_up[backend=osqp]", scenes(plain)[0][1], "osqp"),
        ("catching_up[nonlinear=true]", scenes(plain)[0][1], "quadratic programmes"),
        ("euler", alternating(), "hybrid"),
        ("event_driven", alternating(), "hybrid"),
        ("event_driven", circuit(), "collocation"),
    ],
)
def test_loops_that_are_never_compiled_say_why(method, case, word):
    traj = solve(case, method)
    assert traj.status.ok and traj.stats["loop"] == "host"
    assert word in traj.stats["note"]
