"""The clock compares runs within rounds: what slows a round slows all of it, and a short run is
repeated."""

import numpy as np
import pytest

from nsbench.measure import clock


def fake(monkeypatch, costs, pace):
    """A time that only the runs advance: cost of each run times the pace of its round."""
    now = [0.0]
    calls = {n: 0 for n in costs}
    monkeypatch.setattr(clock.time, "perf_counter", lambda: now[0])

    def run(name):
        def go():
            now[0] += costs[name] * pace(calls)
            calls[name] += 1

        return go

    return {n: run(n) for n in costs}, calls


def test_a_ratio_is_right_on_a_machine_whose_speed_changes_by_ten(monkeypatch):
    rng = np.random.default_rng(3)
    paces = rng.uniform(1.0, 10.0, 40)
    runs, _ = fake(monkeypatch, {"a": 3.0, "b": 1.0}, lambda calls: paces[min(calls.values())])
    found = clock.interleaved(runs, rounds=9)
    r = clock.ratio(found["a"], found["b"])
    assert r.low <= r.median <= r.high and 0.2 < r.median / 3.0 < 5.0


def test_a_short_run_is_repeated_until_its_turn_lasts(monkeypatch):
    runs, calls = fake(monkeypatch, {"short": 1e-4, "long": 1.0}, lambda calls: 1.0)
    found = clock.interleaved(runs, rounds=3, least=0.02)
    assert found["short"].repeats == 200 and found["long"].repeats == 1
    assert calls == {"short": 1 + 3 * 200, "long": 4}
    assert found["short"].median == pytest.approx(1e-4) and found["short"].worst == pytest.approx(
        1e-4
    )
    assert clock.ratio(found["long"], found["short"]).median == pytest.approx(1e4)


def test_every_run_begins_a_round_in_turn(monkeypatch):
    seen = []
    runs = {}
    now = [0.0]
    monkeypatch.setattr(clock.time, "perf_counter", lambda: now[0])

    def make(name):
        def go():
            now[0] += 1.0
            seen.append(name)

        return go

    for n in "abc":
        runs[n] = make(n)
    clock.interleaved(runs, rounds=3)
    assert "".join(seen) == "abc" + "abc" + "bca" + "cab"


def test_nothing_to_time_is_an_error():
    with pytest.raises(ValueError, match="0 runs"):
        clock.interleaved({})
    with pytest.raises(ValueError, match="0 rounds"):
        clock.interleaved({"a": lambda: None}, rounds=0)


def test_a_run_that_compiles_is_timed_without_its_compilation():
    import numba

    @numba.njit
    def late(x):
        return x + 1.0

    calls = []

    def run():
        calls.append(late(float(len(calls))))
        return calls[-1]

    out, seconds, compiled = clock.first_call(run)
    assert len(calls) == 2 and out == 2.0 and compiled > 0.01 > seconds
    assert clock.first_call(run)[2] == 0.0 and len(calls) == 3


def test_compilations_within_one_another_count_once():
    from numba.core import event

    def run():
        with event.trigger_event("numba:compiler_lock"):
            for _ in range(3):
                with event.trigger_event("numba:compiler_lock"):
                    pass

    assert 0.0 < clock.first_call(run)[2] < 1.0
