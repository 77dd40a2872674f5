"""Sentences on what cannot be traced: what to write instead, and the line of the user's file."""

from __future__ import annotations

import re

from nsbench.solvers.event_driven.filippov.tracing.source_lines import failing_places, user_line

NO_NUMBER = (
    "a function of plain numbers, as those of math or scipy, cannot be traced; write functions of "
    "xp, for a spline xp.searchsorted and xp.take"
)
SMOOTH = "write it with sqrt, exp, log, sin, cos, tan, sinh, cosh, tanh and arctan"
# what to write for functions of numpy that cannot be traced
REMEDIES = {
    "equal": "write < or >: equality holds for no length of time",
    "not_equal": "write < or >: equality holds for no length of time",
    **dict.fromkeys(("trunc", "fmod"), "write it with floor or %"),
    **dict.fromkeys(("arcsinh", "arccosh", "arctanh", "cbrt"), SMOOTH),
    "arctan2": "write arctan, as in 2 * xp.arctan(y / (xp.hypot(x, y) + x)) for arctan2(y, x)",
    "sort": "write xp.minimum and xp.maximum of the entries",
}
UNTRACEABLE = (
    TypeError,
    ValueError,
    AttributeError,
    IndexError,
    NotImplementedError,
    OverflowError,
    ZeroDivisionError,
)


def refusal(name: str) -> TypeError:
    """Return the error of a function of numpy that cannot be traced, with what to write instead."""
    remedy = REMEDIES.get(name)
    return TypeError(f"{name} cannot be traced" + (f"; {remedy}" if remedy else ""))


def describe_refusal(error: Exception) -> str:
    """Say what of a case cannot be traced and what to write instead, with the line of its file."""
    places = failing_places(error)
    line = user_line(places)
    text = str(error)
    if not (places[-1].inner or line == str(places[-1])):
        text = NO_NUMBER
    if isinstance(error, IndexError) and "valid indices" in text:
        text = "an index cannot be traced; write xp.take(table, j) for table[j]"
    method = re.fullmatch("'Traced' object has no attribute '(.*)'", text)
    if method:
        text = f"the method {method[1]} of arrays cannot be traced; write the function of xp"
    return f"{line}: {text}" if line else text
