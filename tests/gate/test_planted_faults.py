"""Faults that are put into the code to try the gate are drawn the same for a seed, are Python, and
are gone afterwards."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def studies(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tests" / "studies"))


@pytest.mark.long
def test_a_seed_draws_one_fault_of_each_kind_in_each_place(studies):
    from drawn_faults import PLACES, drawn

    faults = drawn(24)
    assert list(faults) == list(drawn(24)) != list(drawn(25))
    kinds = ("operator", "constant", "index", "line")
    places = [f"{place}, {kind}: " for place in PLACES for kind in kinds]
    assert len(faults) == len(places) == 12
    assert all(name.startswith(place) for name, place in zip(faults, places, strict=True))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
def test_a_drawn_fault_is_python_and_changes_one_place(studies, seed):
    from drawn_faults import drawn

    for name, text, other in drawn(seed).values():
        assert (ROOT / name).read_text(encoding="utf-8") == text
        assert ast.dump(ast.parse(other)) != ast.dump(ast.parse(text)), name


def test_a_file_is_as_before_after_a_fault(studies, tmp_path):
    from copies import broken_in

    path = tmp_path / "a.py"
    path.write_text("x = 1\n")
    before = path.read_bytes(), path.stat().st_mtime_ns
    with broken_in(tmp_path, ("a.py", "x = 1", "x = 2")):
        assert path.read_text() == "x = 2\n"
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before
    with pytest.raises(LookupError, match="0 times"), broken_in(tmp_path, ("a.py", "y", "z")):
        pass


def test_named_faults_apply_and_are_looked_for_where_they_lie(studies):
    from gate_faults import FAULTS, METHODS, methods_of

    for fault in FAULTS.values():
        for file, text, _ in fault if isinstance(fault[0], tuple) else (fault,):
            assert (ROOT / file).read_text(encoding="utf-8").count(text) == 1, file
    assert methods_of(["nsbench/solvers/euler/kernels/loop.py"]) == ("euler[implicit=true]",)
    assert methods_of(["nsbench/dynamics/contacts/kernels/constraint_order.py"]) == METHODS[:2]
    assert methods_of(["nsbench/measure/errors.py"]) == METHODS


def test_every_fault_of_the_mutation_study_applies_once(studies):
    from mutations import FAULTS

    for name, (file, text, _, _) in FAULTS.items():
        assert (ROOT / file).read_text(encoding="utf-8").count(text) == 1, name


def test_a_fault_without_effect_is_drawn_again_and_no_other_with_it(studies, monkeypatch):
    import drawn_faults

    before = drawn_faults.drawn(3)
    title = list(before)[5]
    fault = before[title]
    is_it = lambda path, site, root: drawn_faults.changed(path, site, root)[1] == fault
    named = drawn_faults.named  # of a fault that is known to have no effect, and was drawn again
    monkeypatch.setattr(
        drawn_faults, "named", lambda *place: "it" if is_it(*place) else named(*place)
    )
    monkeypatch.setitem(drawn_faults.WITHOUT_EFFECT, "it", "a reason")
    after = drawn_faults.drawn(3)
    assert len(after) == 12 and set(before) - set(after) == {title}
