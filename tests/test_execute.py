"""Whatever becomes of a run, it is a row, and the others go on."""
import dataclasses
import itertools

from nsbench.execute.local import run_all
from nsbench.study import Spec, attempt, run_batch, substeps_ladder

SOLVER = '''
"""A solver that misbehaves on purpose."""
import os, time
from dataclasses import dataclass
import numpy as np
from nsbench.solvers import Claims, Status, Trajectory

@dataclass(frozen=True)
class Bad:
    """Misbehaves."""
    how: str = "hang"
    accuracy, default, claims = "h", 0.01, Claims()

    def refuses(self, case):
        return None

    def prepare(self, case, h):
        def run():
            if self.how == "hang":
                while True:
                    np.linalg.svd(np.ones((300, 300)))
            if self.how == "exit":
                os._exit(7)
            if self.how == "raise":
                raise RuntimeError("on purpose")
            if self.how == "memory":
                raise MemoryError("on purpose")
            k = len(case.t)
            return Trajectory(case.t, np.tile(case.x0, (k, 1)), (), np.zeros((k, 0)), np.zeros((k, case.n)))
        return run

SOLVER = Bad
'''


def test_hang_exit_and_exception_are_rows_and_the_others_go_on(tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    specs = [Spec("tide", f"bad[how={how}]", "h", 0.01, "", (str(file),))
             for how in ("fine", "hang", "raise", "exit", "memory", "fine2")]
    rows = {}
    run_all([specs, [Spec("tide", "pbd", "h", 0.01)]], 2, 2.0, lambda spec, row: rows.__setitem__(spec, row))
    status = [rows[s]["status"] for s in specs]
    assert status == ["ok", "timeout", "error", "crashed", "oom", "ok"]
    assert "2 s" in rows[specs[1]]["why"] and "code 7" in rows[specs[3]]["why"] and "on purpose" in rows[specs[2]]["why"]
    assert rows[Spec("tide", "pbd", "h", 0.01)]["status"] == "ok"


def test_rows_of_a_repeated_run_agree_to_the_byte():
    spec = Spec("tide", "pbd", "h", 0.01)
    times = ("seconds", "setup_seconds", "seconds_max", "rounds")
    a, b = ({k: repr(v) for k, v in attempt(spec)[0].items() if k not in times} for _ in range(2))
    assert a == b


def test_quick_runs_are_timed_in_rounds_and_each_row_is_given_at_once():
    specs = [Spec("tide", "pbd", "h", h) for h in (0.05, 0.025)]
    seen = list(run_batch(specs))
    assert [i for i, _ in seen] == [0, 1, 0, 1]
    assert seen[-1][1]["rounds"] == 3 and "rounds" not in seen[0][1]


def test_refusal_is_a_row_with_a_sentence():
    row, run = attempt(Spec("sliding", "pbd", "h", 0.1))
    assert row["status"] == "refused" and len(row["why"].split()) > 3 and run is None


def test_ladder_has_enough_steps_over_enough_octaves_and_no_dyadic_rule():
    for first in (1, 2, 3, 7, 40):
        n = substeps_ladder(first)
        assert len(n) >= 18 and n[-1] >= 64 * n[0] and len(set(n)) == len(n)
        ratios = {round(b / a, 6) for a, b in itertools.pairwise(n[8:])}
        assert len(ratios) > 3 and 2.0 not in ratios


def test_specs_are_plain_data():
    assert dataclasses.asdict(Spec("tide", "pbd", "h", 0.1))["asked"] == 0.1
