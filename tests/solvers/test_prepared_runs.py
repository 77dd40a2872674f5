"""`solve` keeps what it has prepared: the same bytes, without preparing again."""

import dataclasses

import numpy as np
import pytest

import nsbench
from nsbench import solvers
from nsbench.solvers import registry
from nsbench.solvers.common.prepared_runs import PreparedRuns
from nsbench.solvers.scaled_run import ScaledRun, is_same_run

CASES = ("tide", "three_discs", "slide_exit", "relay_lcs", "two_surfaces")
PAIRS = [
    (case, spec)
    for case in CASES
    for spec in solvers.standard()
    if solvers.get(spec).refuses(nsbench.get_case(case)) is None
]


@pytest.fixture(autouse=True)
def empty_store(runs_prepared_anew, monkeypatch):
    monkeypatch.setattr(registry, "_prepared", PreparedRuns())


@pytest.fixture
def prepared(monkeypatch):
    """The runs that are prepared, in order."""
    made = []
    prepare = ScaledRun.prepare
    monkeypatch.setattr(
        ScaledRun, "prepare", lambda self, *args: (made.append(self.method), prepare(self, *args))
    )
    return made


def arrays(traj):
    values = [getattr(traj, f.name) for f in dataclasses.fields(traj)]
    flat = [v for value in values for v in (value if isinstance(value, tuple) else (value,))]
    return [v for v in flat if isinstance(v, np.ndarray) and v.size]


@pytest.mark.long
@pytest.mark.parametrize("case, spec", PAIRS)
def test_a_second_call_has_the_bytes_of_the_first_and_leaves_it_alone(case, spec, prepared):
    case = nsbench.get_case(case)
    first = nsbench.solve(case, spec)
    copies = [a.copy() for a in arrays(first)]
    count = len(prepared)
    second = nsbench.solve(case, spec)
    assert len(prepared) == count
    assert is_same_run(first, second)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(arrays(first), copies))
    shared = [a for a in arrays(first) for b in arrays(second) if np.shares_memory(a, b)]
    assert not [a for a in shared if a.flags.writeable and not np.shares_memory(a, case.t)]
    registry._prepared.clear()
    assert is_same_run(nsbench.solve(case, spec), second)


def test_options_accuracies_and_cases_are_prepared_apart(prepared):
    case = nsbench.get_case("tide")
    for spec, h in (("pbd", 0.1), ("pbd", 0.05), ("pbd[order=reverse]", 0.1), ("pbd", 0.1)):
        nsbench.solve(case, spec, h=h)
    assert len(prepared) == 3
    moved = case.replace(x0=np.array([0.6]))
    assert nsbench.solve(moved, "pbd", h=0.1).x[0, 0] == 0.6 and len(prepared) == 4


def test_a_name_stands_for_one_case(prepared):
    for _ in range(3):
        nsbench.solve("tide", "pbd", h=0.1)
    assert len(prepared) == 1


def test_what_a_caller_writes_into_a_result_changes_no_other():
    case = nsbench.get_case("tide")
    first = nsbench.solve(case, "pbd", h=0.1)
    kept = first.x.copy()
    first.x[:] = 7.0
    second = nsbench.solve(case, "pbd", h=0.1)
    assert np.array_equal(second.x, kept) and second.status.ok


def test_a_trajectory_with_the_bytes_of_the_last_is_not_checked_again(monkeypatch):
    case = nsbench.get_case("slide_exit")
    nsbench.solve(case, "event_driven")
    monkeypatch.setattr("nsbench.solvers.common.returned_value.returned_violation", None)
    monkeypatch.setattr("nsbench.solvers.scaled_run.diagnose", None)
    assert nsbench.solve(case, "event_driven").status.ok
    with pytest.raises(TypeError):
        nsbench.solve(case.replace(x0=case.x0 + 0.01), "event_driven")


def test_the_store_is_bounded_in_runs_and_in_numbers():
    store = PreparedRuns(max_runs=3, max_numbers=100)
    for k in range(5):
        store.put(k, 10, f"run {k}")
    assert [store.take(k) for k in range(5)] == [None, None, "run 2", "run 3", "run 4"]
    assert store.take(4) is None  # taken: another thread prepares its own
    for k in range(3):
        store.put(k, 60, k)
    assert [store.take(k) for k in range(3)] == [None, None, 2]
    store.put(0, 1000, "too large")
    assert store.take(0) is None


def test_bad_input_is_refused_whatever_is_kept():
    nsbench.solve("tide", "pbd", h=0.1)
    for accuracy, error in (({"h": "x"}, ValueError), ({"tol": 0.1}, LookupError)):
        with pytest.raises(error):
            nsbench.solve("tide", "pbd", **accuracy)
    assert nsbench.solve("tide", "euler").status.code == "refused"
