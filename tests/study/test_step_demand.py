"""What `nsbench step` is asked for, and whether an estimate from shorter steps can be relied on."""

import math

import numpy as np
import pytest

from nsbench import Case, Complementarity, Distance, Filippov, errors, get_case, solve, solvers
from nsbench.cli import main
from nsbench.error_bars import Bars, ErrorBars
from nsbench.solvers.scaled_run import ScaledRun
from nsbench.study import step_choice
from nsbench.study.search_budget import SearchBudget
from nsbench.study.step_choice import COMPARED, ESTIMATED, Demand, choose, demand_of


def at_rest(*families):
    def drift(xp):
        return lambda t, x: -x

    x0 = np.array([0.0, 0.0, 1.2, 0.0])
    return Case("pair", Complementarity(drift, families), x0=x0, t=np.linspace(0.0, 1.0, 3))


HARD = Distance(d=1.0)
LINK = Distance(d=1.5, sign=-1, pairs=np.array([[0, 1]]))


@pytest.mark.parametrize("families", [(HARD,), (HARD, LINK), (LINK, HARD)])
def test_one_per_cent_of_a_diameter(families):
    assert demand_of(at_rest(*families), "1%", "1%").overlap == pytest.approx(0.01)


def test_links_alone_are_measured_by_their_length():
    assert demand_of(at_rest(LINK), "1%", "1%").overlap == pytest.approx(0.015)


def test_discs_of_radius_one():
    assert demand_of(get_case("discs", n=3), "1%", "1%").overlap == pytest.approx(0.02)


def test_a_step_near_the_chosen_one_keeps_the_error_of_a_method_that_chatters():
    """x' = 1 - 2 s chatters about x = 0 with the amplitude of the step."""
    case = get_case("sliding")
    choice = choose(case, "euler", Demand(1e-3))
    assert choice.is_found and choice.sure == "estimate from shorter steps"
    for part in (1.0, 0.97, 0.9):
        traj = solve(case, solver="euler", h=part * choice.accuracy)
        assert errors(case, traj)["state_sup"] <= 1e-3


@pytest.mark.parametrize("h", [0.05 / 32, 0.05 / 34])
def test_a_step_that_ends_on_the_surface_by_chance_is_not_believed(h):
    case = get_case("sliding")
    search = step_choice._Search(case, "euler", solvers.get("euler"), Demand(1e-6))
    _, found, _ = search._tried(h)
    assert errors(case, solve(case, solver="euler", h=h))["state_sup"] < 1e-12
    assert found.error > 1e-4


def test_the_step_that_is_printed_is_the_step_that_was_run():
    choice = choose(get_case("sliding"), "euler", Demand(1e-2))
    assert float(f"{choice.accuracy:.3g}") == choice.accuracy


def test_a_chatter_of_period_three_is_not_believed_either():
    """x' = -2 above and 1 below x = 0: explicit Euler is back at 0 after every third step."""
    field = lambda xp: lambda t, x, s: xp.stack((-0.5 - 1.5 * s[0],))
    problem = Filippov.signs(field, lambda xp: lambda t, x: x[0:1])
    case = Case("asym", problem, np.zeros(1), np.linspace(0.0, 1.0, 13))
    search = step_choice._Search(case, "euler", solvers.get("euler"), Demand(1e-6))
    assert np.abs(solve(case, solver="euler", h=1 / 36).x).max() < 1e-12
    assert search._tried(1 / 36)[1].error > 1e-3


@pytest.mark.parametrize("intervals", [64, 50, 12, 7])
def test_what_is_printed_takes_the_steps_that_were_meant(intervals):
    case = get_case("sliding").replace(t=np.linspace(0.0, 1.0, intervals + 1))
    search = step_choice._Search(case, "euler", solvers.get("euler"), Demand(1e-2))
    for steps in range(1, 30):
        printed = search._printed(search.spacing / steps)
        assert search._steps(printed) == steps and search._printed(printed) == printed
        one, two = (search._steps(v) for v in search._finer(printed))
        assert one != two and math.gcd(one, steps) == math.gcd(two, steps) == 1


def test_a_case_without_error_bars_is_compared_with_shorter_steps():
    """Two samples are too few for error bars."""
    case = get_case("tide").replace(t=np.array([0.0, 1.0]))
    found = choose(case, "pbd", Demand(0.1))
    assert found.is_found and found.error <= 0.1 and found.sure == COMPARED


def test_an_extrapolation_takes_its_own_error_bars_and_its_order():
    """Shorter steps differed by 1e-13 from a run that missed a touch by 7e-4, and steps were
    shortened as for order one: three times too much."""
    tried = []
    for name, asked in (("graze", 5e-4), ("dragged_disc", 1e-5)):
        case = get_case(name)
        found = choose(case, "richardson", Demand(asked), tried.append)
        run = solve(case, "richardson", h=found.accuracy)
        assert found.sure == ESTIMATED and errors(case, run)["state_sup"] <= asked
    assert found.error > 0.5 * asked
    assert tried[0].startswith("richardson: trying h = ") and "it is 0.0" in tried[1]


def test_an_overlap_is_seen_where_no_error_bar_can_be_had(monkeypatch):
    none = lambda case, traj: ErrorBars(lambda: Bars.none(traj.t, "They could not be computed."))
    monkeypatch.setattr("nsbench.solvers.scaled_run.error_bars", none)
    case = get_case("tide")
    assert not choose(case, "pbd", Demand(0.1)).is_found
    found = choose(case, "pbd", Demand(math.inf, 0.1))
    assert found.is_found and found.violation <= 0.1 and "not known" in found.sure


def test_a_search_ends_within_its_budget_and_says_what_it_would_take(monkeypatch):
    """The first try takes 0.2 s, also again, so that the next one, 32 times as long, is too long.

    Its run is made twice in each.
    """
    tried = []

    def timed(call):
        tried.append(call)
        return call(), 0.05 if isinstance(call, ScaledRun) else 0.2

    monkeypatch.setattr("nsbench.study.search_budget._timed", timed)
    found = choose(get_case("sliding"), "euler", Demand(1e-3), budget=1.0)
    assert not found.is_found and found.why.startswith("Not reached within 1 s (--budget): with h")
    assert found.needs < 1e-3 and found.needs_seconds > 0.05 and len(tried) == 6
    enough = choose(get_case("sliding"), "euler", Demand(1e-3), budget=100.0)
    assert enough.is_found and 0.2 < found.needs / enough.accuracy < 5.0


def test_seconds_of_a_try_are_those_of_the_steps_it_takes():
    budget = SearchBudget("h", 1.0)
    assert math.isnan(budget.expected_run(1e-4))
    budget.runs = {0.1: 1e-3, 0.01: 1e-3, 0.001: 1e-2}
    budget.tries = {0.1: 5e-1, 0.001: 1e-2}  # of the first one nearly all was loading
    budget.spent = 0.012
    assert budget.allows(1.1e-5) and not budget.allows(0.9e-5)
    assert budget.expected_run(1e-4) == pytest.approx(0.1, rel=0.1)
    stiff = SearchBudget("k", 1.0, runs={100.0: 1e-3, 1e4: 1e-1})
    assert stiff.expected_run(1e6) == pytest.approx(10.0)
    assert SearchBudget("k", runs={100.0: 1e-3}).expected_run(1e4) == pytest.approx(1e-2)


def test_a_run_that_is_timed_once_is_made_once(monkeypatch):
    calls = []
    case = get_case("sliding")
    monkeypatch.setattr("nsbench.measure.clock.LONG", 0.0)
    plain = ScaledRun.__call__
    monkeypatch.setattr(ScaledRun, "__call__", lambda run: calls.append(1) or plain(run))
    found = choose(case, "event_driven", Demand(1e-3))
    assert found.is_found and len(calls) == 1


def test_what_is_loaded_in_some_try_does_not_end_a_search(monkeypatch):
    """Of 60 s, 20 go by in the runs of the first try, or of the second one, that load something."""
    plain = step_choice.search_budget._timed
    for late in (1, 3):
        calls = []

        def wait_once(call, late=late, calls=calls):
            calls.append(call)
            slow = 20.0 if len(calls) in (late, late + 1) else 0.0
            out, seconds = plain(call)
            return out, seconds + slow

        monkeypatch.setattr("nsbench.study.search_budget._timed", wait_once)
        found = choose(get_case("dragged_disc"), "richardson", Demand(1e-5))
        assert found.is_found and found.seconds < 1.0 and len(calls) > 4


def test_step_asks_methods_of_a_file(tmp_path, capsys, monkeypatch):
    """By option, and by nsbench.toml of the folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nsbench.toml").write_text('method_files = ["listed.py"]\n')
    for name in ("named", "listed"):  # each in its own file: a loaded method stays known
        assert main(["new", "method", name, "--kind", "switch"]) == 0
    for name, more in (("listed", []), ("named", ["--solvers", "named.py"])):
        assert main(["step", "slide_exit", "--error", "1e-2", "-s", name, *more]) == 0
        assert f"Take {name} with h = " in capsys.readouterr().out


def test_a_step_for_the_overlap_alone_says_that_it_keeps_no_error(capsys):
    for error, said in (([], True), (["--error", "1"], False)):
        assert main(["step", "tide", "--overlap", "0.1", *error, "-s", "pbd"]) == 0
        last = capsys.readouterr().out.splitlines()[-1]
        assert last.startswith("Take pbd")
        assert ("No error of the state was asked for: it is 0." in last) == said


def test_a_search_that_ends_at_the_most_steps_says_so(monkeypatch):
    monkeypatch.setattr("nsbench.study.step_choice.MOST_STEPS", 2000)
    found = choose(get_case("sliding"), "euler", Demand(1e-6))
    assert not found.is_found
    assert found.why.startswith("Not reached with 2e3 steps, the most of a search: with h")
