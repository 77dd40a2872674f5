"""Kernels that call the functions of a case, bound to a scene, and its neighbour list."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.case_functions import (
    bind_loop,
    compile_functions,
    curve_function,
    files_in_python,
)
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.error_bars.contact_rows import ContactRows
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.kernels import case_rows, error_flow, local_piece
from nsbench.error_bars.unit_gradients import for_kernel
from nsbench.problem import Smooth

if TYPE_CHECKING:
    from nsbench.error_bars.kernels.local_piece import Piece

SKIN = 2.0  # times the reach: as far as pairs are listed


class SceneKernels:
    """Follow the constrained motion of a scene piece by piece, and errors along it.

    The kernels are compiled; where numba cannot compile a function of the case, or a constraint is
    a Smooth one, their source runs in Python. Pairs are listed with a skin (Verlet, Phys. Rev. 159,
    1967), and anew when the state has moved so far that others may be as near. every: the rows of
    all constraints, where there are few and all are flat; else None.
    """

    def __init__(self, scene: ConstraintSet, drift: Drift, every: ContactRows | None):
        self.scene = scene
        self.drift = drift
        self._has_smooth = any(isinstance(c, Smooth) for c in scene.families)
        self._functions, self._loop = self._case_functions()
        self._bound: dict[Callable, Callable] = {}
        self._rows = every
        self._listed = every and every.listed(np.zeros(scene.n), 0.0, True)

    def _case_functions(self) -> tuple[tuple, str]:
        """Return drift, walls and anchors for the kernel, and "compiled" or "host"."""
        scene = self.scene
        functions = (
            self.drift.function,
            curve_function(scene.b_factory, len(scene.inv2), scene.b),
            curve_function(scene.anchor_factory, scene.anchors(0.0).size, scene.anchors),
        )
        if self._has_smooth:
            return tuple(f.in_python() for f in functions), "host"
        found = compile_functions(*functions)
        return found.functions, found.loop

    def _list(self, y: np.ndarray, reach: float) -> None:
        """List all contacts with a gap of at most `reach` at y (n,)."""
        near = self.scene.near(y, reach)
        self._rows = ContactRows(self.scene, near.ids, near)
        self._listed = self._rows.listed(y, reach, False)

    def follow_piece(self, t: float, dt: float, y: np.ndarray) -> tuple[ContactRows, Piece]:
        """Return the piece from the state y (n,) of S at the time t, over at most dt, and the rows
        among which its contacts are counted. Raises ArithmeticError for a drift that is no number.
        """
        y = for_kernel(y)
        if self._listed is None:
            self._list(y, 0.0)
        piece = self._call(float(t), float(dt), y)
        if piece.asked:
            self._list(y, SKIN * piece.asked)
            piece = self._call(float(t), float(dt), y)
        if piece.asked or not np.all(np.isfinite(piece.end)):
            raise ArithmeticError(f"the drift at t = {t:g} in own units is not finite")
        return self._rows, piece

    def _call(self, t: float, dt: float, y: np.ndarray) -> Piece:
        smooth = self._smooth(self._rows)
        args = (*self._functions, smooth, self.drift.units, self._listed, t, dt, y)
        return self._kernel(local_piece.follow_piece, args)(*args)

    def carry_error(
        self,
        rows: ContactRows,
        face: ContactRows,
        t: float,
        H: float,
        states: np.ndarray,
        q: np.ndarray,
        delta: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the error delta (n,) after a time H, and the integral (n,) of J delta over it.

        rows, with multipliers q (m,): contacts that act meanwhile; face: that act at the end too.
        states (2, n): in the middle and at the end.
        """
        new = np.empty(len(delta))
        along = np.empty(len(delta))
        functions = (*self._functions, self._smooth(rows), self._smooth(face), self.drift.units)
        arrays = (for_kernel(states), for_kernel(q), for_kernel(delta), new, along)
        args = (*functions, rows.as_list, face.as_list, float(t), float(H), *arrays)
        self._kernel(error_flow.carry_error, args)(*args)
        return new, along

    def _smooth(self, rows: ContactRows) -> Callable | None:
        return rows.fill_smooth if self._has_smooth else None

    def _kernel(self, kernel: Callable, args: tuple) -> Callable:
        """Return what is called for a kernel with arguments of these types."""
        if kernel not in self._bound:
            in_python = lambda k: files_in_python(k, case_rows.__name__, k.py_func.__module__)
            self._bound[kernel] = bind_loop(kernel, self._loop, args, in_python)
        return self._bound[kernel]
