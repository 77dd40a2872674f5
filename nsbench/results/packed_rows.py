"""Rows of a study in little room: a tenth of what a dict of each would take."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, MutableMapping


class PackedRows(MutableMapping):
    """Rows by key, given back equal to what was put in, each time as a dict of its own.

    The names of a row's columns are kept once for all rows that have the same, its floats side by
    side (8 bytes each), and each word once.
    """

    def __init__(self):
        self._packed: dict[str, tuple] = {}
        self._layouts: dict[
            tuple, tuple
        ] = {}  # (name, is it a float?) of every column, each itself
        self._words: dict[str, str] = {}

    def __setitem__(self, key: str, row: dict) -> None:
        layout = tuple((name, type(v) is float) for name, v in row.items())
        floats = array("d", [v for v in row.values() if type(v) is float])
        others = tuple(
            self._words.setdefault(v, v) if type(v) is str else v
            for v in row.values()
            if type(v) is not float
        )
        self._packed[key] = self._layouts.setdefault(layout, layout), floats.tobytes(), others

    def __getitem__(self, key: str) -> dict:
        layout, floats, others = self._packed[key]
        numbers = iter(array("d", floats))
        rest = iter(others)
        return {name: next(numbers if is_float else rest) for name, is_float in layout}

    def __delitem__(self, key: str) -> None:
        del self._packed[key]

    def __contains__(self, key) -> bool:
        return key in self._packed

    def __iter__(self) -> Iterator[str]:
        return iter(self._packed)

    def __len__(self) -> int:
        return len(self._packed)


class OrderedRows:
    """The rows of these keys, as often as they are asked for; instead(i) makes that of a key, the
    i-th, that has none."""

    def __init__(self, rows: PackedRows, keys: Iterable[str], instead):
        self.rows = rows
        self.keys = list(keys)
        self.instead = instead

    def __len__(self) -> int:
        return len(self.keys)

    def __iter__(self) -> Iterator[dict]:
        for i, key in enumerate(self.keys):
            yield self.rows[key] if key in self.rows else self.instead(i)
