"""Say why JAX cannot trace a function of a case: in which line, and what to write instead."""

from __future__ import annotations

import re
import traceback
from pathlib import Path

from nsbench.input_errors import PACKAGE

CASES = f"{PACKAGE}/cases/"
# what a function does, and what to write instead, by the class or the text of what was raised
REMEDIES = (
    (
        "TracerBoolConversionError",
        "branches on a value (`if`, `and`, `max(a, b)`); write xp.where(c, a, b) for `if c`, "
        "xp.maximum(a, b) for max",
    ),
    (
        "TracerIntegerConversionError|Only integer scalar arrays",
        "takes an index, or a number of turns, from a value; write xp.take(table, i), or "
        "xp.where(c, a, b)",
    ),
    (
        "NonConcreteBooleanIndexError",
        "picks entries by a condition; write xp.where(c, a, b)",
    ),
    (
        "ConcretizationTypeError",
        "makes a number of Python of a value, as float(x[0]) and functions of math do; write x[0], "
        "and xp.sin for math.sin",
    ),
    (
        "TracerArrayConversionError|setting an array element with a sequence",
        "gives a value to numpy; write xp.sin for np.sin, and a list for an array that is filled",
    ),
    (
        "requires ndarray or scalar arguments, got <class '(list|tuple)'>",
        "gives a list or tuple to a function of arrays; write xp.array([a, b]) for [a, b]",
    ),
    (
        "JAX arrays are immutable",
        "assigns to entries of an array; return a list of the entries, or write xp.where(c, a, b)",
    ),
)


class NotTraceable(TypeError):
    """A function of a case is not one of JAX arrays; the message says which line, and why."""


def refusal(case: str, error: NotTraceable) -> str:
    """Return the sentence by which a method refuses the case of this key."""
    return f"JAX cannot trace the functions of {case}: {error}."


def describe_jax_error(error: Exception) -> str:
    """Describe what was raised while JAX traced a function: line, what it does, remedy."""
    line = next(iter(str(error).strip().splitlines()), "").rstrip(".")
    raised = f"{type(error).__name__}: {line}"
    what = next((w for pattern, w in REMEDIES if re.search(pattern, raised)), f"raises {raised}")
    return f"{_user_line(error) or 'a function'} {what}"


def _user_line(error):
    """Name the deepest line of the file of the user that took part, "" if there is none."""
    frames = [
        (frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)
    ]
    own = next((file for file, _ in frames if not _is_library(file)), None)
    found = [line for file, line in frames if file == own]
    return f"line {found[-1]} of {Path(own).name}" if found else ""


def _is_library(file):
    import jax

    inner = (f"{PACKAGE}/", *(f"{path}/" for path in jax.__path__))
    return file.startswith(inner) and not file.startswith(CASES)
