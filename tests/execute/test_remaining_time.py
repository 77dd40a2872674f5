"""The time left is right within a factor two soon after the first runs, also where the first ones
compile; a line of progress names no accuracy of a run that is refused."""

import random
import time

import numpy as np
import pytest

from nsbench.execute.forecast import MEASURE, seconds_with_repetitions, work
from nsbench.execute.progress import Progress, Waiting
from nsbench.execute.remaining_time import FIXED_WORK, RemainingTime
from nsbench.execute.workers.kernel_schedule import kernel_group
from nsbench.execute.workers.pool import WorkerPool
from nsbench.execute.workers.process import Worker
from nsbench.study import Spec

SOLVERS = {"pbd": (2e-7, 5.0), "euler": (1e-7, 15.0), "theta": (5e-7, 1.5), "kdtree": (1e-6, 0.0)}
CASES = ("tide", "three_discs", "apple")
NAN = float("nan")


def study(seed):
    """(spec, seconds, compilation) of the runs of a study, in the order in which they end."""
    rng = random.Random(seed)
    met = set()
    runs = []
    for case in CASES:
        for solver, (rate, compilation) in SOLVERS.items():
            group = kernel_group(Spec(case, solver, "h", 0.1))
            for h in 0.05 / np.geomspace(1.0, 64.0, 19):
                spec = Spec(case, solver, "h", float(h))
                seconds = rate * (work(spec) + FIXED_WORK) * rng.lognormvariate(0.0, 0.4)
                runs.append((spec, seconds, 0.0 if group in met else compilation))
                met.add(group)
            runs.append((Spec(case, "penalty", "k", NAN), 0.0, 0.0))
    return runs


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("jobs", [2, None])
def test_the_time_left_is_right_within_a_factor_of_two(seed, jobs):
    runs = study(seed)
    workers = 2
    remaining = RemainingTime([spec for spec, _, _ in runs], jobs)
    costs = [
        seconds_with_repetitions(seconds, 0.0) + compilation + MEASURE * (seconds > 0.0)
        for _, seconds, compilation in runs
    ]
    for done, (spec, seconds, compilation) in enumerate(runs, 1):
        remaining.add(spec, {"seconds": seconds, "compile_seconds": compilation})
        elapsed = sum(costs[:done]) / workers
        left = sum(costs[done:]) / workers
        if 80 <= done <= len(runs) - 20:  # every solver has been met, and no rest of a moment
            assert 0.5 * left < remaining.seconds(elapsed) < 2.0 * left, (done, left)


def test_compilations_of_the_first_runs_are_not_expected_of_all():
    specs = [Spec("tide", "pbd", "h", 0.05 / k) for k in range(1, 201)]
    remaining = RemainingTime(specs, 1)
    for k, spec in enumerate(specs[:5]):
        remaining.add(spec, {"seconds": 1e-3, "compile_seconds": 0.0 if k else 30.0})
    assert remaining.seconds(31.0) < 60.0  # 195 runs of milliseconds, not of 6 s each


def test_a_refused_run_has_no_accuracy_in_the_line():
    printed = []
    refused = Spec("sliding", "pbd", "h", NAN)
    bar = Progress([refused], 1, lambda text, end="\n": printed.append(text), True)
    bar.step(refused, {"status": "refused"})
    assert "sliding pbd" in printed[0] and "nan" not in printed[0] and "1/1" in printed[0]
    assert bar.failed == 0


def test_a_line_of_progress_says_what_is_compiled_and_for_how_long():
    printed = []
    spec = Spec("tide", "pbd[order=reverse]", "h", 0.1)
    bar = Progress([spec], 1, lambda text, end="\n": printed.append(text), True)
    bar.printed_at -= 1.0
    bar.tell_compilation(spec)
    assert "compiling pbd, once, about 45 s" in printed[0] and "0/1" in printed[0]
    bar.remaining.add(spec, {"seconds": 1e-3, "compile_seconds": 30.0})
    assert bar.remaining.compilation() == 37.5
    bar.remaining.add(spec, {"seconds": 1e-3, "compile_seconds": 0.5})
    assert bar.remaining.compilation() == 37.5


def test_a_worker_that_waits_longer_for_a_kernel_than_loading_takes_is_compiling():
    specs = [Spec("tide", "pbd", "h", 0.1), Spec("tide", "pbd", "h", 0.05)]
    pool = WorkerPool([], None, None, None, 1, 1 << 30)
    for phase, index, ago in (("compile", 1, 3.0), ("compile", 0, 0.0), ("run", 0, 9.0)):
        since = time.monotonic() - ago
        pool.busy.append(Worker(None, None, specs=specs, phase=phase, index=index, since=since))
    assert pool.compiling() == [specs[1]]
    pool.busy[0].index = -1  # compiled before the first run was announced
    assert pool.compiling() == []


def test_what_has_no_steps_of_its_own_says_now_and_then_that_it_goes_on():
    printed = []
    waiting = Waiting("references", printed.append)
    waiting.tell()
    waiting.start -= 40.0
    waiting.printed_at -= 20.0
    waiting.tell()
    waiting.tell()
    assert printed == ["references: 40 s so far"]
