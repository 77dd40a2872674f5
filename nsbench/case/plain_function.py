"""A case from a function f(t, y) as it is written for scipy.integrate.solve_ivp.

A function that jumps inside, as with np.sign(y[0]), is known as values alone: its fields on both
sides of a surface c = 0 are read off it. The field of the side s is

    f(t, y)                                       where s c > 0: f decides by itself,
    2 f(d) - f(2 d)                               on the surface,
    the same minus (f(2 d) - f(d)) b / d          beyond it by 0 < b < d,
    twice the value on the surface minus f(b)     farther beyond it,

f(a) meaning f at the point with s c = a on the line through y along the gradient of c. The offset d
is OFFSET_IN_SIZES of the size of y, so that the value on the surface is right to its square; what
stands beyond the surface makes the field smooth there for a step that passes it, and no motion
depends on it. A surface that only time moves is left along time.
"""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from nsbench.case.definition import Case
from nsbench.problem import Complementarity, Filippov, float_array
from nsbench.user_code import loaded_file

OFFSET_IN_SIZES = 1e-7  # its square is below the tolerance of any method
ROUNDING = 64.0 * float(np.finfo(float).eps)  # of the size of c: below, a state is on the surface
CLEARLY_OFF = 1e-9  # of the size of c: above, no slope is needed to see on which side a state is
SLOPE_STEP = 1e-6  # of the size of a coordinate, for central differences of c
MAX_NEWTON_STEPS = 8  # to a point on the other side of a curved surface
MAX_SURFACES = 8  # there is a field for each of the 2^d sides
SLOW = (
    "runs of {name} are in Python (column loop: host), about a hundred times slower than compiled "
    "ones: {why}; write the fields as factories of an array namespace for those "
    "(nsbench.Filippov, docs/cases_and_solvers.md)"
)


def from_function(
    f: Callable[[float, np.ndarray], Any],
    surfaces: Callable | Sequence[Callable] | None,
    y0: Any,
    t: Any,
    name: str | None = None,
    **fields: Any,
) -> Case:
    """Build a case from f(t, y) -> (n,), in numpy, as for scipy.integrate.solve_ivp.

    surfaces: functions c(t, y) -> number on whose zeros f jumps, or one; None or (): f is smooth.
    y0 (n,): start. t (k,): sample times. name, fields: of the Case; by default doc is
    that of f, and name that of the case file that is being loaded, or "function".

    With surfaces the problem is a Filippov system, whose fields on both sides of a surface are read
    off f (see the head of this module); without, a Complementarity problem that has no constraints.
    A UserWarning says when its runs cannot be compiled. f must depend on its arguments alone, and
    jump nowhere but on the surfaces. Raises TypeError or ValueError for what does not fit.
    """
    start = float_array("y0", y0, 1)
    times = float_array("t", t, 1)
    listed = [surfaces] if callable(surfaces) else list(surfaces or ())
    if not callable(f):
        raise TypeError(f"f is {f!r:.60}; a function f(t, y) is needed")
    for k, c in enumerate(listed):
        if not callable(c):
            raise TypeError(f"surface {k} is {c!r:.60}; a function c(t, y) is needed")
    if len(listed) > MAX_SURFACES:
        raise ValueError(f"{len(listed)} surfaces; at most {MAX_SURFACES} are taken")
    fields.setdefault("doc", inspect.getdoc(f) or "")
    name = _name_of_file() if name is None else name
    if listed:
        case = Case(name, _filippov(f, listed, start, times), start, times, **fields)
        why = "one-sided fields of a function that jumps inside are not traced"
    else:
        returns_array = isinstance(f(float(times[0]), start.copy()), np.ndarray)
        drift = (lambda xp: f) if returns_array else _as_arrays(f)
        case = Case(name, Complementarity(drift), start, times, **fields)
        why = "" if returns_array else "f returns no array, but a list or a number"
    if why:
        warnings.warn(SLOW.format(name=name, why=why), stacklevel=2)
    return case


def _name_of_file() -> str:
    """Return the name of the case file that is being loaded, with "_" for what no name may hold."""
    file = loaded_file()
    return re.sub(r"[^A-Za-z0-9_.-]", "_", file.stem)[:80] if file else "function"


def _as_arrays(f: Callable) -> Callable:
    """Return the factory of f with its values as float64 arrays."""
    return lambda xp: lambda t, y: np.asarray(f(t, y), float)


def _filippov(f, surfaces, y0: np.ndarray, times: np.ndarray) -> Filippov:
    """Return the Filippov system of f with a field for each side."""
    sides = OneSidedFields(f, surfaces, y0, times)
    modes = {
        signs: _in_numpy(lambda t, y, s=np.array(signs, float): sides.value(t, y, s))
        for signs in product((1, -1), repeat=len(surfaces))
    }
    return Filippov(modes, _in_numpy(sides.switch))


def _in_numpy(function: Callable) -> Callable:
    """Return the factory of a function that exists in numpy alone.

    In any other array namespace it raises TypeError when called, as methods expect of functions
    that they cannot trace.
    """

    def make(xp: Any) -> Callable:
        if xp is np:
            return function

        def untraceable(*args: Any) -> np.ndarray:
            raise TypeError("a function of numpy, not of an array namespace, is not traced")

        return untraceable

    return make


class OneSidedFields:
    """The fields of the 2^d sides of d surfaces, from a function that jumps on them.

    sizes (n,): of the coordinates near the start, by the start itself and by its motion to the
    second sample. span: length of the run. largest_size (d,): change of each c by a displacement
    of these sizes, the largest one so far.
    """

    def __init__(self, f: Callable, surfaces: list[Callable], y0: np.ndarray, times: np.ndarray):
        self.f = f
        self.surfaces = surfaces
        self.span = float(times[-1] - times[0])
        with np.errstate(all="ignore"):
            moved = np.abs(np.asarray(f(float(times[0]), y0.copy()), float)) * np.diff(times[:2])
        sizes = np.maximum(np.abs(y0), np.where(np.isfinite(moved), moved, 0.0))
        self.sizes = np.where(sizes > 0.0, sizes, sizes.max() or 1.0)
        self.largest_size = np.zeros(len(surfaces))

    def switch(self, t: Any, y: np.ndarray) -> np.ndarray:
        """Return (d,) the values of the surfaces' functions."""
        return np.array([np.asarray(c(t, y)).reshape(()) for c in self.surfaces])

    def value(self, t: float, y: np.ndarray, signs: np.ndarray) -> np.ndarray:
        """Return the field (n,) of the side with the signs (d,), continued beyond its surfaces."""
        c = signs * self.switch(t, y)
        if np.all(c > CLEARLY_OFF * self.largest_size):
            return self._at(t, y)
        slopes = self._slopes(t, y)
        weights = self._weights(y, slopes)
        size = np.sqrt((slopes**2) @ weights)
        self.largest_size = np.fmax(self.largest_size, size)
        beyond = np.flatnonzero(c <= ROUNDING * size)
        if not beyond.size:
            return self._at(t, y)
        offset = OFFSET_IN_SIZES * size[beyond]
        depth = np.maximum(-c[beyond], 0.0)

        def off(distance: np.ndarray) -> np.ndarray | None:
            return self._value_off(t, y, signs, beyond, distance, weights)

        near = off(offset)
        far = off(2.0 * offset)
        if near is None or far is None:
            return self._at(t, y)
        on_surface = 2.0 * near - far
        ratio = float(np.max(depth / offset))
        if ratio <= 1.0:
            return on_surface - (far - near) * ratio
        mirrored = off(np.maximum(depth, offset))
        return on_surface if mirrored is None else 2.0 * on_surface - mirrored

    def _at(self, t, y) -> np.ndarray:
        return np.asarray(self.f(t, y.copy()), float)

    def _slopes(self, t, y) -> np.ndarray:
        """Return (d, 1 + n) the derivatives of the surfaces' functions in t and y."""
        steps = SLOPE_STEP * np.append(self.span, np.maximum(np.abs(y), self.sizes))
        columns = []
        for j, step in enumerate(steps):
            move = np.zeros(steps.size)
            move[j] = step
            ahead = self.switch(t + move[0], y + move[1:])
            columns.append((ahead - self.switch(t - move[0], y - move[1:])) / (2.0 * step))
        return np.array(columns).T

    def _weights(self, y, slopes) -> np.ndarray:
        """Return (1 + n,) squares of sizes; of time 0, but where a surface has no slope in y."""
        weights = np.append(self.span, np.maximum(np.abs(y), self.sizes)) ** 2
        if np.all((slopes[:, 1:] ** 2) @ weights[1:] > (ROUNDING * slopes[:, 0]) ** 2 * weights[0]):
            weights[0] = 0.0
        return weights

    def _value_off(self, t, y, signs, rows, distance, weights) -> np.ndarray | None:
        """Return f at the point with s_i c_i = distance_i for the surfaces `rows`, else None.

        Newton's method along the gradients, in units of the sizes of the coordinates.
        """
        point = np.append(t, y)
        aim = signs[rows] * distance
        for _ in range(MAX_NEWTON_STEPS):
            miss = aim - self.switch(point[0], point[1:])[rows]
            if np.all(np.abs(miss) <= 0.1 * OFFSET_IN_SIZES * distance):
                return self._at(point[0], point[1:])
            slopes = self._slopes(point[0], point[1:])[rows]
            if not np.all(np.isfinite(slopes)):
                return None
            scaled = slopes * np.sqrt(weights)
            point = point + np.sqrt(weights) * np.linalg.lstsq(scaled, miss, rcond=None)[0]
        reached = signs[rows] * self.switch(point[0], point[1:])[rows]
        return self._at(point[0], point[1:]) if np.all(reached > 0.5 * distance) else None
