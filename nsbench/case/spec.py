"""Specs of cases and methods: parse and format ``name[a=1,b=x]``."""

from __future__ import annotations

import re


def format_value(value: object) -> str:
    """Write a parameter value as it is typed in a spec: true, false, 0.1, 30, text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, float):
        return str(value)
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def parse_spec(spec: str) -> tuple[str, dict]:
    """Split ``name[a=1,b=x]`` into the name and a dict of parameters (bool, int, float or text).

    Raises ValueError with the text that cannot be read.
    """
    m = re.fullmatch(r"\s*([^\[\]=,]+?)\s*(?:\[(.*)\])?\s*", spec)
    if not m:
        raise ValueError(f"cannot read {spec[:200]!r}; write name or name[key=value,...]")
    params = {}
    for part in filter(None, (s.strip() for s in (m[2] or "").split(","))):
        key, eq, text = part.partition("=")
        if not eq or key.strip() in params:
            raise ValueError(
                f"cannot read {part!r} in {spec[:200]!r}; write key=value, each key once"
            )
        params[key.strip()] = parse_value(text.strip())
    return m[1], params


def parse_value(text: str) -> bool | int | float | str:
    """Read a parameter value: the first of bool, int, float that fits, else the text itself."""
    low = text.lower()
    if low in ("true", "false"):
        return low == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text

