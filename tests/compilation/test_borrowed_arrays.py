"""Arrays whose references are not counted, and callbacks that scale on their stack."""

from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

import nsbench
from nsbench import Affine, Case, Complementarity
from nsbench.compilation.borrowed_arrays import borrowed, stack_array
from nsbench.compilation.decorators import inlined, njit
from nsbench.compilation.factories import STACK, Scaling, as_numpy, rhs_cfunc, signed_rhs_cfunc
from nsbench.dynamics.scaling.scaled_case import _function, _signed


class Inner(NamedTuple):
    values: np.ndarray


class Outer(NamedTuple):
    inner: Inner
    values: np.ndarray
    size: int


@inlined
def twice(x):
    return 2.0 * x


@njit
def write(outer, n):
    lent = borrowed(outer)
    lent.values[:n] = 3.0
    lent.inner.values[0] = twice(1.5)
    part = lent.values[n:]
    for i in range(part.size):
        part[i] = i
    return lent.size


def test_what_is_written_to_a_borrowed_array_is_in_the_array():
    outer = Outer(Inner(np.zeros(1)), np.zeros(4), 7)
    assert write(outer, 2) == 7
    assert np.array_equal(outer.values, [3.0, 3.0, 0.0, 1.0])
    assert np.array_equal(outer.inner.values, [3.0])


@njit
def write_beside_a_closure(outer, n):
    lent = borrowed(outer)
    after = lambda i: i + 1.0  # numba removes dead code where it inlines one
    lent.values[0] = after(n)
    lent.inner.values[0] = sum([after(i) for i in range(n)])


def test_a_write_beside_a_closure_is_no_dead_code():
    outer = Outer(Inner(np.zeros(1)), np.zeros(4), 7)
    write_beside_a_closure(outer, 2)
    assert outer.values[0] == 3.0 and outer.inner.values[0] == 3.0


def test_a_tuple_with_other_owners_is_not_borrowed():
    @njit
    def lend(values):
        return borrowed((values, [values]))[0].size

    with pytest.raises(TypingError, match="borrowed takes arrays and numbers"):
        lend(np.zeros(2))


def test_in_python_a_borrowed_array_is_the_array():
    x = np.zeros(2)
    assert borrowed(x) is x


@njit
def sum_on_the_stack(n):
    total = 0.0
    y = stack_array(n)
    for i in range(n):
        y[i] = i
    for i in range(n):
        total += y[i]
    return total


def test_an_array_on_the_stack_holds_what_is_written_to_it():
    assert [sum_on_the_stack(n) for n in (0, 1, 100)] == [0.0, 0.0, 4950.0]


SIZE = np.array([0.5, 2.0, 8.0])
UNIT = np.array([4.0, 0.25, 1.0])


def vector(xp):
    return lambda t, x: xp.sin(x) + t


def reversed_view(xp):
    return lambda t, x: x[::-1]


def the_state(xp):
    return lambda t, x: x


def one_value(xp):
    return lambda t, x: x[:1] * t


def number(xp):
    return lambda t, x: x[0] * t


def two_of_three(xp):
    return lambda t, x: x[:2]


def failing(xp):
    def f(t, x):
        if t > 0.0:
            raise ValueError("no drift")
        return x

    return f


def called(factory, x, size, unit, n):
    """Return the values of the compiled callback of `factory` in own units, at t = 0.3."""
    scaled = _function(factory, 0.25, 2.0, size, unit)
    assert isinstance(scaled(np).scaling, Scaling)
    pointer = rhs_cfunc(scaled, n)
    out = np.zeros(n)
    call(pointer, 0.3, x, out)
    return out, scaled


@njit
def call(f, t, x, out):
    f(t, x, out)


@pytest.mark.parametrize("factory", [vector, reversed_view, the_state, one_value, number])
@pytest.mark.parametrize(("size", "unit"), [(SIZE, UNIT), (np.array([2.0]), np.array([0.5]))])
def test_a_callback_in_own_units_gives_the_bits_of_numpy(factory, size, unit):
    x = np.array([0.1, -0.7, 3.0])
    out, scaled = called(factory, x, size, unit, 3)
    assert np.array_equal(out, np.broadcast_to(as_numpy(scaled)(0.3, x), 3))
    assert np.array_equal(x, [0.1, -0.7, 3.0])


KEPT = []


def test_what_a_drift_keeps_in_python_is_not_on_the_stack():
    def keeping(xp):
        def f(t, x):
            with numba.objmode():
                KEPT.append(x)
            return x

        return f

    KEPT.clear()
    for start in (1.0, 2.0, 3.0):
        called(keeping, np.full(3, start), np.array([2.0]), np.array([0.5]), 3)
    assert [k.tolist() for k in KEPT] == [[2.0] * 3, [4.0] * 3, [6.0] * 3]


def test_an_attribute_of_a_drift_of_that_name_means_nothing():
    def named(xp):
        def f(t, x):
            return -x

        f.scaling = 2.0
        return f

    x = np.array([0.1, -0.7, 3.0])
    out = np.zeros(3)
    call(rhs_cfunc(named, 3), 0.3, x, out)
    assert np.array_equal(out, -x)
    out, _ = called(named, x, np.ones(1), np.array([0.5]), 3)
    assert np.array_equal(out, -0.5 * x)


class Pull:
    """A drift that is no function of Python."""

    def __call__(self, t, x):
        return -x


@numba.njit
def compiled_pull(t, x):
    """A drift that its author compiled."""
    return -x


@pytest.mark.parametrize("make", [lambda xp: Pull(), lambda xp: compiled_pull])
@pytest.mark.parametrize("method", ["pbd", "theta"])
def test_a_drift_that_is_another_callable_is_run(make, method):
    walls = (Affine(np.eye(2), np.full(2, -0.5)),)
    case = Case("pull", Complementarity(make, walls), np.ones(2), np.linspace(0.0, 1.0, 5))
    plain = case.replace(problem=Complementarity(lambda xp: lambda t, x: -x, walls))
    x = nsbench.solve(case, method, h=0.05).x
    assert np.array_equal(x, nsbench.solve(plain, method, h=0.05).x)


def test_more_coordinates_than_the_stack_has_room_for_are_scaled_too():
    x = np.linspace(-1.0, 1.0, STACK + 3)
    out, scaled = called(vector, x, np.array([2.0]), np.array([0.5]), x.size)
    assert np.array_equal(out, as_numpy(scaled)(0.3, x))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("factory", [two_of_three, failing])
def test_a_callback_in_own_units_that_fails_leaves_no_numbers(factory):
    size, unit = np.array([2.0]), np.array([0.5])
    assert np.all(np.isnan(called(factory, np.ones(3), size, unit, 3)[0]))


@pytest.mark.parametrize(
    ("origin", "time", "size"), [(0.0, 1.0, 1.0), (0.5, 1.0, 1.0), (0.0, 2.0, 1.0), (0.0, 1.0, 4.0)]
)
def test_a_function_scaled_twice_is_scaled_at_once_if_only_its_value_is(origin, time, size):
    own = _function(vector, 0.25, 2.0, SIZE, UNIT)
    twice_scaled = _function(own, origin, time, np.array([size]), np.array([8.0]))
    scaling = twice_scaled(np).scaling
    at_once = (origin, time, size) == (0.0, 1.0, 1.0)
    assert at_once == (np.array_equal(scaling.size, SIZE) and scaling.time == 2.0)
    x = np.array([0.1, -0.7, 3.0])
    out = np.zeros(3)
    call(rhs_cfunc(twice_scaled, 3), 0.3, x, out)
    assert np.array_equal(out, as_numpy(twice_scaled)(0.3, x))


def test_a_field_in_own_units_gives_the_bits_of_numpy():
    def field(xp):
        return lambda t, x, s: xp.cos(x) * s[0] + t

    scaled = _signed(field, 0.25, 2.0, SIZE)
    x, s, out = np.array([0.1, -0.7, 3.0]), np.array([-0.5]), np.zeros(3)

    @njit
    def call_signed(f, t, x, s, out):
        f(t, x, s, out)

    call_signed(signed_rhs_cfunc(scaled, 3, 1), 0.3, x, s, out)
    assert np.array_equal(out, as_numpy(scaled)(0.3, x, s))
