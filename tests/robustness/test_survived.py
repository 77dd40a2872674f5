"""Every entry of the list of what must be survived has a test, and no test is marked with what is
not on the list."""

from survival_table import ENTRIES, marked


def test_every_entry_has_a_test_and_every_mark_an_entry():
    names = [e.name for e in ENTRIES]
    tests = marked()
    assert len(names) == len(set(names))
    assert not [n for n in names if n not in tests]
    assert not set(tests) - set(names)
