"""Lists, tuples and numbers that functions of a case return or join are numpy's, in every form."""

import math

import numba
import numpy as np
import pytest

from nsbench import Case, solve
from nsbench.compilation import factories
from nsbench.compilation.user_forms import jax_errors, sequences  # noqa: F401  (registers)
from nsbench.dynamics.scaling.scaled_case import scaled_case
from nsbench.problem import Affine, Complementarity, Filippov, Hybrid, Transition

X = np.random.default_rng(5).normal(size=3)


def lists(x):
    return (
        np.stack([x[1], -x[0]]),
        np.stack([x[1], 2 * x[0]], axis=-1),
        np.stack([x, -x[::-1]]),
        np.stack([x, 2.0 * x], axis=1),
        np.stack([(x[0], 1), (2, x[1])], 1),
        np.hstack([x[1], -x[0]]),
        np.hstack([x, x[:1]]),
        np.vstack([x[1], -x[0]]),
        np.vstack([x, -x]),
        np.concatenate([x[1:], -x[:1]]),
        np.asarray([x[:1], x[1:2]]),
        np.array([x, -x]),
        np.atleast_1d([x[0], 1]),
    )


def tuples(x):
    return (
        np.stack((x[1], 1, -x[0])),
        np.stack((x, [1, 2, x[0]]), axis=1),
        np.hstack((x[:2], -x[0], [1, 2], (3.0, x[1]))),
        np.hstack((1, 2)),
        np.vstack((x[1], 2)),
        np.vstack((x, (1, 2, 3))),
        np.concatenate((x[1:], [0.0], (1, x[2]))),
        np.asarray((x[:1], x[1:2])),
        np.asarray((x[0], 1, 2.5)),
        np.asarray((True, x[0])),
        np.atleast_1d(x[0]),
    )


@pytest.mark.long
@pytest.mark.parametrize("forms", [lists, tuples])
def test_joined_sequences_are_those_of_numpy(forms):
    for k, (found, wanted) in enumerate(zip(numba.njit(forms)(X), forms(X), strict=True)):
        assert found.dtype == wanted.dtype and np.array_equal(found, wanted), k


WRONG = [
    lambda x: np.asarray((x[:1], x[1])),
    lambda x: np.asarray([x[:1], x[1:]]),
    lambda x: np.stack([x[0], x[1]], axis=1),
    lambda x: np.stack((x[:1], x[1])),
    lambda x: np.stack([x, x[1:]]),
    lambda x: np.concatenate([x[0], x[1]]),
    lambda x: np.concatenate([x, x], axis=1),
    lambda x: np.vstack((x, 2.0)),
]


@pytest.mark.parametrize("form", WRONG)
def test_what_numpy_refuses_is_refused(form):
    with pytest.raises((ValueError, np.exceptions.AxisError)):
        form(X)
    with pytest.raises((ValueError, numba.core.errors.TypingError)):
        numba.njit(form)(X)


def compiled(f, size=3):
    """Call the compiled form of f(xp, t, x), which fills `size` floats."""
    pointer = factories.rhs_cfunc.__wrapped__(lambda xp: lambda t, x: f(xp, t, x), size)
    out = np.full(size, 7.0)
    numba.njit(lambda g, t, x, out: g(t, x, out))(pointer, 0.4, X, out)
    return out


RETURNED = {
    "a list": lambda xp, t, x: [x[1], -x[0], xp.sin(t)],
    "a tuple": lambda xp, t, x: (x[1], -x[0], xp.sin(t)),
    "a mixed tuple": lambda xp, t, x: (x[0], 1, 2.5),
    "vectors": lambda xp, t, x: (x[:1], x[1:2], -x[2:]),
    "a list that grows": lambda xp, t, x: [v * t for v in x],
}


@pytest.mark.parametrize("f", RETURNED.values(), ids=RETURNED)
def test_callbacks_take_sequences(f):
    assert np.array_equal(compiled(f), np.ravel(f(np, np.float64(0.4), X)))


def test_numbers_fill_and_wrong_lengths_give_none():
    assert np.array_equal(compiled(lambda xp, t, x: -1.0), np.full(3, -1.0))
    assert np.isnan(compiled(lambda xp, t, x: [x[0], x[1]])).all()
    with pytest.raises(factories.CompileError):
        compiled(lambda xp, t, x: (x[:1], x[1], 1.0))


def test_a_number_for_one_coordinate_is_told_to_be_a_list():
    drift = lambda xp: lambda t, x: -1.0
    with pytest.raises(ValueError, match=r"drift of one .*\(1,\) is needed: write `return \[v\]`"):
        Case("one", Complementarity(drift), np.ones(1), np.linspace(0.0, 1.0, 5))


def stacks(xp):
    def f(t, x):
        return xp.stack([x[1], xp.sin(t) - x[0]])

    return f


def listed(xp):
    def f(t, x):
        return [x[1], xp.sin(t) - x[0]]

    return f


def in_a_tuple(xp):
    def f(t, x):
        return x[1], xp.sin(t) - x[0]

    return f


FORMS = {  # of a drift, another drift, a wall and a surface
    "stack": (
        stacks,
        lambda xp: lambda t, x: xp.stack([1.0 - x[1], -x[0]]),
        lambda xp: lambda t: xp.stack([0.5 + 0.1 * t]),
        lambda xp: lambda t, x: xp.stack([x[0] - 0.5]),
    ),
    "list": (
        listed,
        lambda xp: lambda t, x: [1.0 - x[1], -x[0]],
        lambda xp: lambda t: [0.5 + 0.1 * t],
        lambda xp: lambda t, x: [x[0] - 0.5],
    ),
    "tuple": (
        in_a_tuple,
        lambda xp: lambda t, x: (1.0 - x[1], -x[0]),
        lambda xp: lambda t: (0.5 + 0.1 * t,),
        lambda xp: lambda t, x: (x[0] - 0.5,),
    ),
}


def case(problem):
    return Case("sequences", problem, np.array([0.7, 0.1]), np.linspace(0.0, 1.0, 5))


def contacts(drift, other, wall, surface):
    return case(Complementarity(drift, (Affine(np.eye(1, 2), wall),)))


def switched(drift, other, wall, surface):
    return case(Filippov({1: other, -1: drift}, surface))


def relay(drift, other, wall, surface):
    return case(Filippov.relay(drift, np.array([[-0.5], [0.2]]), surface))


@pytest.mark.parametrize(
    "build, method, step",
    [
        (contacts, "pbd", {"h": 0.05}),
        pytest.param(contacts, "pbd_jax", {"h": 0.05}, marks=pytest.mark.long),
        (switched, "euler", {"h": 0.05}),
        (switched, "event_driven", {}),
        (switched, "penalty", {}),
        (relay, "euler", {"h": 0.05}),
        (relay, "event_driven", {}),
    ],
)
def test_runs_have_the_bits_of_arrays(build, method, step):
    runs = [solve(build(*functions), method, **step) for functions in FORMS.values()]
    assert [(run.status.code, run.stats["loop"]) for run in runs] == [("ok", "compiled")] * 3
    assert all(np.array_equal(runs[0].x, run.x) for run in runs[1:])


def test_functions_in_numpy_and_scaled_ones_return_arrays():
    """Of a guard that is a list, times the number that is its unit; of a drift on the host."""
    leaves = Transition("on", lambda xp: lambda t, x: [x[0] - 0.5], "on")
    scaled = scaled_case(case(Hybrid({"on": listed}, (leaves,)))).case.problem
    assert np.shape(scaled.transitions[0].guard(np)(0.0, np.ones(2))) == (1,)
    assert np.shape(0.5 * factories.as_numpy(in_a_tuple)(0.0, X[:2])) == (2,)


def branches(xp):
    def f(t, x):
        if x[0] > 9.0:
            return x
        return -x

    return f


def fills(xp):
    def f(t, x):
        y = 2.0 * x
        y[0] = x[1]
        return y

    return f


UNTRACED = {
    "branches on a value.*xp.where": branches,
    "assigns to entries.*a list": fills,
    "functions of math.*xp.sin": lambda xp: lambda t, x: [math.sin(x[0]), x[1]],
    "float.*write x.0.": lambda xp: lambda t, x: [float(x[0]), x[1]],
    "to numpy.*xp.sin for np.sin": lambda xp: lambda t, x: np.sin(x),
    "a list or tuple.*xp.array": lambda xp: lambda t, x: xp.hstack((x[:1], [1.0])),
    "picks entries.*xp.where": lambda xp: lambda t, x: x[x > -9.0],
    "an index.*xp.take": lambda xp: lambda t, x: [2.0, 1.0][xp.argmax(x)] * x,
    "raises AttributeError.*nothing": lambda xp: lambda t, x: xp.nothing(x),
}


@pytest.mark.parametrize("said, factory", UNTRACED.items(), ids=UNTRACED)
def test_what_jax_cannot_trace_is_named_with_its_line(said, factory):
    import jax

    made = factories.as_jax(factory)
    with pytest.raises(jax_errors.NotTraceable, match=rf"^line \d+ of test_sequences.py .*{said}"):
        jax.eval_shape(made, 0.0, X)


@pytest.mark.parametrize("method", ["penalty", "pbd_jax"])
def test_methods_in_jax_refuse_with_that_sentence(method):
    found = solve(case(Complementarity(branches, (Affine(np.eye(1, 2), np.ones(1)),))), method)
    line = branches(np).__code__.co_firstlineno + 1
    assert found.status.code == "refused"
    assert f"line {line} of test_sequences.py branches on a value" in str(found.status)
