"""Every method of the bench is cited by entries that exist; a page holds those that it needs."""

import re

import pytest

from nsbench import solvers
from nsbench.report.tables import citation_table
from nsbench.report.tables.citation_table import bibtex_of, describe_entry, read_entries, sources_of


@pytest.mark.parametrize("name", solvers.all_names())
def test_every_method_has_a_source_and_every_key_an_entry(name):
    assert name in citation_table.SOURCES and name in citation_table.LIBRARIES
    assert set(sources_of(name)) <= set(read_entries())


def test_every_entry_is_needed_and_complete():
    options = [k for found in citation_table.BY_OPTION.values() for _, keys in found for k in keys]
    needed = {k for name in solvers.all_names() for k in sources_of(name)} | set(options)
    assert needed == set(read_entries())
    for key, entry in read_entries().items():
        assert entry.count("{") == entry.count("}") and re.search(r"\btitle\s*=", entry), key
        assert "{" not in describe_entry(key) and "\\" not in describe_entry(key)


def test_options_choose_the_library():
    assert "osqp" in sources_of("catching_up[backend=osqp]")
    assert "goldfarb1983" not in sources_of("catching_up[backend=osqp]")
    assert "goldfarb1983" in sources_of("catching_up") and "goldfarb1983" not in sources_of("pbd")
    assert "maury2011" in sources_of("richardson[method=catching_up]")


def test_each_entry_is_written_once_that_of_pbd_first():
    text = bibtex_of(["pbd", "pbd[order=reverse]", "kdtree"])
    keys = re.findall(r"@\w+\{(\w+),", text)
    assert keys[0] == "pbd" and len(keys) == len(set(keys)) and "bentley1975" in keys


def test_a_method_of_a_user_is_said_to_have_no_known_source():
    (line,) = citation_table.citation_table(["mine[a=1]"]).rows
    assert line.cells[1].text == citation_table.UNKNOWN
    assert describe_entry("mueller2007") == "Müller et al. 2007 (mueller2007)"
