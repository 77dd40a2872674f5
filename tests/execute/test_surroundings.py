"""A run that changes what all runs of its process share changes no other run's numbers."""

import pytest
from solver_file import solver

from nsbench.execute.workers.pool import run_all
from nsbench.study import Spec

SOLVER = solver(
    """
    if self.how == "spoil":
        np.random.seed(7), random.seed(7)
        np.seterr(all="ignore")
        np.set_printoptions(precision=1)
        os.chdir("/")
        os.environ["NSBENCH_RUDE"], os.environ["HOME"] = "1", "/nowhere"
        jax.config.update("jax_enable_x64", False)
        jax.config.update("jax_disable_jit", True)
        sys.setrecursionlimit(5000)
        sys.stdout.close()
        sys.path.insert(0, "/nowhere")
        warnings.simplefilter("error")
        # downward, or so
        ctypes.CDLL(None).fesetround(0x400 if os.uname().machine == "x86_64" else 0x800000)
    elif self.how == "look":
        third = float(np.float64(1.0) / np.float64(3.0) - 0.1)
        print(np.random.random(), random.random(), np.geterr()["over"], np.get_printoptions()["precision"],
              os.getcwd(), os.environ.get("NSBENCH_RUDE"), os.environ.get("HOME"), jax.config.jax_enable_x64,
              jax.config.jax_disable_jit, sys.getrecursionlimit(), sys.path[0], repr(third), file=sys.stdout)
        warnings.warn("once")
""",
    how="look",
    before="import jax\n\n",
)
TIMES = {
    "seconds",
    "seconds_low",
    "seconds_high",
    "seconds_max",
    "setup_seconds",
    "compile_seconds",
    "rounds",
}


@pytest.mark.long
@pytest.mark.survives("global state")
def test_what_a_run_changes_is_put_back_before_the_next_one(tmp_path):
    file = tmp_path / "rude.py"
    file.write_text(SOLVER)

    def ran(*specs):
        rows = {}
        said = []
        run_all(
            [[*specs]],
            1,
            60.0,
            lambda s, r: rows.__setitem__(s, r),
            on_output=lambda s, text: said.append(text),
        )
        return {
            s: {k: repr(v) for k, v in r.items() if k not in TIMES} for s, r in rows.items()
        }, said

    look, spoil = (
        Spec("tide", f"rude[how={how}]", "h", 0.01, "", (str(file),)) for how in ("look", "spoil")
    )
    again = Spec("tide", "rude[how=look]", "h", 0.02, "", (str(file),))
    others = [
        Spec("tide", "pbd", "h", 0.01),
        Spec("tide", "pbd[order=random]", "h", 0.01),
        Spec("tide", "penalty", "k", 100.0),
    ]
    clean, before = ran(look, *others)
    rows, after = ran(spoil, look, again, *others)
    assert {r["status"] for r in (*clean.values(), *rows.values())} == {"'ok'"}
    assert before[0].split(b"\n")[0] == after[0].split(b"\n")[0] == after[1].split(b"\n")[0]
    assert {s: rows[s] for s in clean} == clean
    assert rows[look]["warnings"] == rows[again]["warnings"] == "1"
