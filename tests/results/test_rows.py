"""Rows that are kept in little room come back as they were."""

import math
import sys

import pytest

from nsbench.results import tables
from nsbench.results.journal import Journal, clean, restore
from nsbench.results.packed_rows import OrderedRows, PackedRows
from nsbench.results.row_reuse import reusable_rows

ROWS = {
    "a": {
        "case": "tide",
        "h": 0.1,
        "steps": 3,
        "ok": True,
        "none": None,
        "bad": math.nan,
        "far": -math.inf,
        "zero": -0.0,
    },
    "b": {"case": "tide", "h": 2, "steps": 0.5, "ok": 1.0, "why": "because"},
    "c": {},
}


def test_rows_come_back_equal_in_their_order_and_each_as_its_own():
    kept = PackedRows()
    kept.update(ROWS)
    assert [*kept] == [*ROWS] and len(kept) == 3 and "a" in kept and "d" not in kept
    for key, row in ROWS.items():
        assert repr(kept[key]) == repr(row) and [type(v) for v in kept[key].values()] == [
            type(v) for v in row.values()
        ]
    kept["a"]["h"] = 7.0
    assert kept["a"]["h"] == 0.1
    kept["a"] = ROWS["c"]
    del kept["b"]
    assert dict(kept) == {"a": {}, "c": {}}
    assert [*OrderedRows(kept, ("c", "x", "a"), lambda i: {"i": i})] == [{}, {"i": 1}, {}]


def test_a_row_takes_a_tenth_of_the_room_of_a_dict():
    kept = PackedRows()
    rows = [
        {f"column {k}": k + 0.5 * i if k % 4 else f"word {k}" for k in range(50)}
        for i in range(100)
    ]
    for i, row in enumerate(rows):
        kept[i] = row
    size = sum(sys.getsizeof(p) + sum(map(sys.getsizeof, p[1:])) for p in kept._packed.values())
    plain = sum(sys.getsizeof(r) + sum(map(sys.getsizeof, r.values())) for r in rows)
    assert len(kept._layouts) == 1 and len(kept._words) == 13 and size < 0.25 * plain, (size, plain)


def test_tables_are_the_same_in_blocks_of_any_size(tmp_path, monkeypatch):
    rows = [
        {
            "case": "tide",
            "n": i,
            "x": i / 7,
            "ok": bool(i % 2),
            "late": "word" if i > 7 else None,
            "mixed": i if i < 9 else "x",
            "true": i < 9 or 0.5,
            "never": None,
        }
        | ({"new": 1.0} if i > 6 else {})
        for i in range(10)
    ]
    found = []
    for size in (1, 3, 10, 10_000):
        monkeypatch.setattr(tables, "BLOCK", size)
        found.append((tables.write_tables(tmp_path, rows), (tmp_path / "runs.csv").read_bytes()))
    assert all(f == found[0] for f in found)
    assert found[0][1].splitlines()[0] == b"case,n,x,ok,late,mixed,true,never,new"


def test_what_is_known_leaves_out_what_is_to_be_made_again(tmp_path):
    journal = Journal(tmp_path)
    for key, status in (
        ("a", "ok"),
        ("b", "crashed"),
        ("c", "ok"),
        ("c", "oom"),
        ("d", "oom"),
        ("d", "ok"),
    ):
        journal.append(key, {"status": status})
    journal.close()
    assert dict(reusable_rows(tmp_path, [], {}, 1.0, [])) == {
        "a": {"status": "ok"},
        "d": {"status": "ok"},
    }


def test_a_whole_number_comes_back_if_it_has_64_bits():
    for number in (2**63 - 1, -(2**63)):
        assert restore({"n": number}) == {"n": number}
    for number in (2**63, -(2**63) - 1):
        with pytest.raises(ValueError, match="n is beyond 64 bits"):
            restore({"n": number})


def test_whole_numbers_beyond_64_bits_become_floats():
    largest = int(sys.float_info.max)
    row = {"a": 2**63, "b": -largest, "c": 10**400, "d": -(10**400), "e": -(2**63)}
    kept = clean(row)
    assert kept == {"a": 2.0**63, "b": -float(largest), "c": "inf", "d": "-inf", "e": -(2**63)}
    assert [type(kept[k]) for k in "abe"] == [float, float, int]
