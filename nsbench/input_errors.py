"""Sentences about faults of a user's file: place, quantity, what is wrong, remedy.

An exception of Python or numpy says what it met, not where in the file nor what is meant. Here it
gets the line of the user's file that it came from, and the remedy where the fault is a usual one.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

MAX_NAMES_IN_A_SENTENCE = 12  # a longer list of names does not fit in two lines
PACKAGE = str(Path(__file__).parent)
PLAIN = (ValueError, TypeError, LookupError)  # exceptions whose text is the whole sentence


def nearest(word: str, words: Iterable[str]) -> str:
    """Suggest the closest of the words, or list them: the end of an error message."""
    words = sorted(words)
    same = [w for w in words if w.casefold() == word.casefold()]
    close = same or difflib.get_close_matches(word, words, 1, 0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    if len(words) <= MAX_NAMES_IN_A_SENTENCE:
        return f"there are: {', '.join(words)}"
    shown = ", ".join(words[:MAX_NAMES_IN_A_SENTENCE])
    return f"there are {len(words)}, such as {shown}; `nsbench list` shows all"


def named_fields(cls: type) -> type:
    """Let a dataclass name the field that does not fit its arguments, with the nearest one.

    Decorator of the classes that users write in their files. Raises TypeError with the sentence.
    """
    assign = cls.__init__

    @functools.wraps(assign)
    def __init__(self, *args: object, **fields: object) -> None:
        try:
            inspect.signature(assign).bind(self, *args, **fields)
        except TypeError:
            raise TypeError(_misfit(cls, assign, args, fields)) from None
        assign(self, *args, **fields)

    cls.__init__ = __init__
    return cls


def _misfit(cls: type, assign: Callable, args: tuple, fields: dict) -> str:
    """Say which argument does not fit the fields of a dataclass."""
    parameters = list(inspect.signature(assign).parameters.values())[1:]
    names = [p.name for p in parameters]
    for name in fields:
        if name not in names:
            return f"{cls.__name__} has no field {name!r}; {nearest(name, names)}"
    if len(args) > len(names):
        return f"{cls.__name__} takes {len(names)} fields, not {len(args)}: {', '.join(names)}"
    twice = [name for name in names[: len(args)] if name in fields]
    if twice:
        return f"{cls.__name__} is given {twice[0]!r} twice: by place and by name"
    given = {*names[: len(args)], *fields}
    missing = [p.name for p in parameters if p.default is p.empty and p.name not in given]
    needed = ", ".join(f"{name}=..." for name in missing)
    return f"{cls.__name__} lacks {', '.join(map(repr, missing))}; write {cls.__name__}({needed})"


def check_factory(name: str, value: object, inner: str) -> None:
    """Check that a value can be called with the array namespace alone; inner: "f(t, x)" it returns.

    Raises TypeError with how a factory is written.
    """
    if not callable(value):
        raise TypeError(
            f"{name} must be a factory taking the array namespace, got {value!r:.80}; {_how(inner)}"
        )
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):  # of some functions written in C
        return
    try:
        signature.bind(None)
    except TypeError:
        called = getattr(value, "__name__", "it")
        raise TypeError(
            f"{name} must be a factory taking the array namespace alone, but {called} takes "
            f"{signature}; {_how(inner)}"
        ) from None


def _how(inner: str) -> str:
    return f"write `def make(xp):` around `def {inner}:` and end it with `return {inner[0]}`"


def describe(error: BaseException, path: str | Path) -> str:
    """Describe what code of the file at `path` raised: line, function, exception, remedy.

    A sentence of the package itself stands alone; to an exception of Python or of a library its
    class is added.
    """
    place = place_of(error, path)
    head = f"{path}{place}: " if place else f"{path}: "
    text = str(error)
    if isinstance(error, SyntaxError):
        return f"{head}{type(error).__name__}: {error.msg}"
    if type(error) not in PLAIN:
        text = f"{type(error).__name__}: {text}"
    return f"{head}{text}{remedy(error)}"


def place_of(error: BaseException, path: str | Path) -> str:
    """Return ", line N" and the function of the deepest line of the file that took part, or ""."""
    path = str(path)
    if isinstance(error, SyntaxError) and error.filename == path:
        return f", line {error.lineno}"
    found = ""
    for e in _causes(error):
        for frame, line in traceback.walk_tb(e.__traceback__):
            if frame.f_code.co_filename == path:
                inside = frame.f_code.co_name
                where = "" if inside.startswith("<") else f" (in {inside})"
                found = f", line {line}{where}"
    return found


def _causes(error: BaseException) -> Iterator[BaseException]:
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__


def remedy(error: BaseException) -> str:
    """Return what to do about an exception of Python or numpy, as the end of a sentence, or ""."""
    text = str(error)
    if isinstance(error, ModuleNotFoundError):
        return "; install it, or name the folder that holds it in PYTHONPATH"
    module = re.search(r"cannot import name '(\w+)' from '([\w.]+)'", text)
    if module is None:
        module = re.search(r"module '([\w.]+)' has no attribute '(\w+)'", text)
        if module is None:
            return ""
        home, name = module.groups()
    else:
        name, home = module.groups()
    known = sys.modules.get(home)
    public = [n for n in getattr(known, "__all__", None) or dir(known) if n[0] != "_"]
    close = difflib.get_close_matches(name, public, 1, 0.5)
    return f"; did you mean {close[0]!r}?" if close and repr(close[0]) not in text else ""
