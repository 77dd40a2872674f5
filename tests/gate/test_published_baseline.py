"""The published baseline is one of the present cases, references, methods and ladders: the gate can
compare it."""

import functools
from pathlib import Path

import pytest

from nsbench.case import get_case
from nsbench.gate import baseline
from nsbench.gate.facts import digest
from nsbench.study.describe import describe_case, describe_solver
from nsbench.study.plan import plan_runs, suite_cases

LINES = baseline.read(Path(__file__).resolve().parents[2] / "reports" / "baseline.csv")


@pytest.mark.long
def test_it_has_the_runs_of_the_standard_suite_under_their_present_configuration():
    asked: dict[tuple, list[float]] = {}
    for spec in plan_runs([(key, "") for key in suite_cases("standard")], None):
        asked.setdefault((spec.case, spec.solver), []).append(spec.asked)
    assert asked.keys() == {key[:2] for key in LINES}
    told_of_case = functools.cache(lambda key: describe_case(get_case(key)))
    told_of_solver = functools.cache(describe_solver)
    for (case, solver), config in {(key[:2], x.config) for key, x in LINES.items()}:
        case_told = told_of_case(case)
        solver_told = told_of_solver(solver)
        ladder = [f"{v:.12g}" for v in sorted(v for v in asked[case, solver] if v == v)]
        now = {
            "case": case_told.get("digest", ""),
            "reference": case_told.get("reference_digest", ""),
            "solver": solver_told.get("digest", ""),
            "ladder": ladder,
        }
        assert config == " ".join(f"{name}={digest(v)}" for name, v in now.items()), (case, solver)


def test_most_of_it_is_held_and_every_line_says_why_it_stands_so():
    assert sum(x.held for x in LINES.values()) > 0.9 * len(LINES) > 5000
    assert all(x.why for x in LINES.values())


def test_digests_are_as_long_as_those_that_are_published():
    """Longer ones would be of another configuration on every line."""
    words = {word for x in LINES.values() for word in x.config.split()}
    assert {len(word.partition("=")[2]) for word in words} == {len(digest("any"))}
