"""What one run does to its process, the next one in the same process does not see; what it warns of
is counted."""

from pathlib import Path

import pytest
from solver_file import solver

from nsbench.execute.workers.pool import run_all
from nsbench.study import Spec

MEDDLER = solver(
    """
    if self.how == "meddle":
        np.random.seed(99)
        random.seed(99)
        np.seterr(all="raise")
        jax.config.update("jax_enable_x64", False)
        jax.config.update("jax_debug_nans", True)
        warnings.simplefilter("error")
        os.environ["OMP_NUM_THREADS"] = "64"
        os.chdir("/")
    if self.how == "warn":
        for text in ("one", "two"):
            warnings.warn(text)
        warnings.warn("three")
    found = {"drawn": float(np.random.rand()), "also": random.random(), "errors": repr(np.geterr()),
             "x64": jax.config.jax_enable_x64,
             "nans": jax.config.jax_debug_nans, "threads": os.environ.get("OMP_NUM_THREADS", ""), "here": os.getcwd()}
""",
    how="look",
    before="import jax\n\n",
    stats="found",
)
SEEN = ("status", "drawn", "also", "errors", "x64", "nans", "threads", "here")


def rows(folder, *hows, jobs=1):
    file = folder / "meddler.py"
    file.write_text(MEDDLER)
    specs = [
        Spec("tide", f"meddler[how={how}]", "h", 0.01 / (1 + i), "", (str(file),))
        for i, how in enumerate(hows)
    ]
    specs += [Spec("tide", "penalty", "k", 100.0), Spec("tide", "pbd", "h", 0.01)]
    found = {}
    run_all([specs], jobs, 60.0, lambda spec, row, *_: found.__setitem__(spec, row))
    return [found[s] for s in specs]


@pytest.mark.long
@pytest.mark.survives("global state", "threads", "warnings")
def test_what_a_run_changes_the_next_one_does_not_see(tmp_path):
    before, _, after, warned, last, penalty, pbd = rows(
        tmp_path, "look", "meddle", "look", "warn", "look"
    )
    assert [r["status"] for r in (before, after, warned, last, penalty, pbd)] == ["ok"] * 6
    for row in (after, last):
        assert {k: row[k] for k in SEEN} == {k: before[k] for k in SEEN}
    assert before["x64"] and not before["nans"] and before["threads"] == "1"
    assert penalty["state_sup"] < 0.1
    assert (
        warned["warnings"] == 2 and before["warnings"] == after["warnings"] == 0
    )  # by the place that warns


@pytest.mark.long
@pytest.mark.survives("threads")
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are looked up in /proc")
def test_each_of_several_workers_computes_with_one_thread(tmp_path):
    file = tmp_path / "counter.py"
    file.write_text(
        solver(
            """
        jax.jit(lambda a: a @ a)(jax.numpy.ones((200, 200))).block_until_ready()
        names = [open(f"/proc/self/task/{t}/comm").read() for t in os.listdir("/proc/self/task")]
        found = {"xla": sum("XLAEigen" in name for name in names), "numba": numba.get_num_threads()}
    """,
            before="import jax, numba\n\n",
            stats="found",
        )
    )
    specs = [
        [Spec("tide", f"counter[how={how}]", "h", 0.01, "", (str(file),))] for how in ("one", "two")
    ]
    found = {}  # by run: a short one comes again, with more times

    def keep(spec, row, *_):
        found.setdefault(spec, set()).add((row["status"], row["xla"], row["numba"]))

    run_all(specs, 2, 60.0, keep)
    assert list(found.values()) == [{("ok", 1, 1)}] * 2
