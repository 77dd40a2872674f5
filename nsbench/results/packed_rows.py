"""Store the rows of a study in memory, in a tenth of the space of a dict each."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, MutableMapping


class PackedRows(MutableMapping):
    """Rows by key; each look-up returns a new dict, equal to the row that was stored.

    Names of columns are stored once for all rows that have the same ones, floats in one array (8
    bytes each), and each text once.
    """

    def __init__(self):
        self._packed: dict[str, tuple] = {}
        self._layouts: dict[tuple, tuple] = {}  # (name, is it a float?) of every column
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
        values = iter(others)
        return {name: next(numbers if is_float else values) for name, is_float in layout}

    def __delitem__(self, key: str) -> None:
        del self._packed[key]

    def __contains__(self, key) -> bool:
        return key in self._packed

    def __iter__(self) -> Iterator[str]:
        return iter(self._packed)

    def __len__(self) -> int:
        return len(self._packed)


class OrderedRows:
    """Rows in the order of `keys`, as an iterable that can be gone through several times.

    missing_row(i) makes the row of the i-th key, where there is none.
    """

    def __init__(self, rows: PackedRows, keys: Iterable[str], missing_row: Callable[[int], dict]):
        self.rows = rows
        self.keys = list(keys)
        self.missing_row = missing_row

    def __len__(self) -> int:
        return len(self.keys)

    def __iter__(self) -> Iterator[dict]:
        for i, key in enumerate(self.keys):
            yield self.rows[key] if key in self.rows else self.missing_row(i)
