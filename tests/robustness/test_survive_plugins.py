"""A plugin that is broken, named like another, or strange takes nothing with it: it is told by
name."""

import re
import sys

import nsbench.cases
import numpy as np
import pytest
from survive_files import HEAD, METHODS, case_file

import nsbench
from nsbench import solvers
from nsbench.case import registry as cases
from nsbench.cli import main
from nsbench.solvers import registry
from nsbench.study.result_contract import contract_violation
from nsbench.trajectory import STATUSES, Status, Trajectory

SOLVER = '''"""A solver that was made for a test."""
from dataclasses import dataclass
import numpy as np
from nsbench.solvers import Claims, Trajectory


@dataclass(frozen=True)
class Still:
    {doc}
    accuracy, default, claims = "h", 0.01, Claims()

    def refuses(self, case):
        return None

    def prepare(self, case, h):
        {prepare}
        def run():
            {run}
            k = len(case.t)
            return Trajectory(case.t, np.tile(case.x0, (k, 1)), (), np.zeros((k, 0)), np.zeros((k, case.n)), stats={stats})
        return run


SOLVER = Still
'''


def solver(folder, name="still", doc='"""Stays where it is."""', prepare="", run="", stats="{}"):
    path = folder / f"{name}.py"
    path.write_text(SOLVER.format(doc=doc, prepare=prepare, run=run, stats=stats))
    return path


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    """Two more folders of plugins; the scans are made anew, here and after the test."""
    folders = {}
    for package, module in (("cases", cases), ("solvers", registry)):
        folders[package] = tmp_path / package
        folders[package].mkdir()
        home = nsbench.cases if package == "cases" else solvers
        monkeypatch.setattr(home, "__path__", [*home.__path__, str(folders[package])])
        module._scan.cache_clear()
    before = set(sys.modules)
    yield folders
    for name in set(sys.modules) - before:
        if name.startswith(("nsbench.cases.", "nsbench.solvers.")):
            del sys.modules[name]
    monkeypatch.undo()
    cases._scan.cache_clear()
    registry._scan.cache_clear()


BROKEN = {
    "missing": "import no_such_library",
    "raises": "raise RuntimeError('on purpose')",
    "half": "def (",
    "exits": "import sys; sys.exit(3)",
    "leaves": "import os; os._exit(0)",
    "nothing": "x = 1",
}
MAKES = """
def make():
    {}


SUITES = {{"smoke": [{{}}]}}
"""


@pytest.mark.survives("broken plugin")
def test_plugins_that_do_not_load_are_listed_with_the_reason_and_the_others_work(
    plugins, tmp_path, capsys
):
    for name, text in BROKEN.items():
        for package in plugins.values():
            (package / f"zz_{name}_{package.name}.py").write_text(text)
    bare = solver(plugins["solvers"], "zz_bare")
    bare.write_text(
        bare.read_text().replace("    accuracy, default", "    speed: float\n    accuracy, default")
    )
    (plugins["solvers"] / "zz_five.py").write_text("SOLVER = 5")
    (plugins["solvers"] / "zz_class.py").write_text("class SOLVER: pass")
    solver(plugins["solvers"], "zz_silent", doc="")
    plain = case_file(plugins["cases"], name="zz_plain")
    plain.write_text(plain.read_text().split("\n", 1)[1])
    assert main(["list"]) == 0
    told = capsys.readouterr().out
    for name, said in (
        ("missing", "no_such_library"),
        ("raises", "on purpose"),
        ("half", "SyntaxError"),
        ("exits", "SystemExit"),
        ("leaves", "os._exit(0)"),
        ("nothing", "neither CASE nor make"),
        ("nothing", "does not define SOLVER"),
    ):
        assert any(
            f"zz_{name}" in line and "FAILED TO LOAD" in line and said in line
            for line in told.splitlines()
        ), name
    assert re.search(r"zz_five .*FAILED TO LOAD.*SOLVER.*is 5", told) and re.search(
        r"zz_class .*FAILED TO LOAD.*dataclass", told
    )
    assert re.search(r"zz_bare .*FAILED TO LOAD.*no default of speed", told)
    assert re.search(r"zz_silent +Still", told) and re.search(r"zz_plain +\(says nothing", told)
    for args, said in (
        (["run", "zz_raises_cases"], "on purpose"),
        (["run", "tide", "-s", "zz_raises_solvers"], "on purpose"),
    ):
        assert main(args) == 2
        assert said in capsys.readouterr().err
    assert (
        main(["run", "tide", "-s", "pbd", "--h", "0.1", "-o", str(tmp_path / "r"), "--plan"]) == 0
    )
    assert nsbench.solve("tide", "pbd", h=0.1).status.ok


@pytest.mark.survives("broken plugin")
def test_a_registered_case_that_cannot_be_made_is_left_out_and_told(plugins, tmp_path, capsys):
    makes = {
        "raises": ("raise NameError('nowhere')", "NameError: nowhere"),
        "gone": ("exit(0)", "SystemExit"),
        "leaves": ("import os; os._exit(0)", "os._exit(0)"),
    }
    for name, text in {"broken": "1/0"}.items() | {
        n: MAKES.format(does) for n, (does, _) in makes.items()
    }.items():
        (plugins["cases"] / f"zz_{name}.py").write_text(text)
    for name, (_, said) in makes.items():
        assert main(["show", f"zz_{name}"]) == 2
        assert said in capsys.readouterr().err, name
    assert (
        main(
            [
                "run",
                "--suite",
                "smoke",
                "-s",
                "pbd",
                "--h",
                "0.1",
                "--plan",
                "--probe",
                "0",
                "-o",
                str(tmp_path / "r"),
            ]
        )
        == 3
    )
    told = capsys.readouterr().out
    assert all(f"left out: zz_{name}" in told for name in (*makes, "broken"))
    assert int(re.search(r"(\d+) to run", told)[1]) >= 8, told


@pytest.mark.survives("same name")
def test_registered_names_that_are_equal_but_for_case_name_both_files(plugins, capsys):
    one = case_file(plugins["cases"], name="zz_twin")
    other = case_file(plugins["cases"], name="ZZ_twin")
    for name in ("zz_twin", "ZZ_twin"):
        assert main(["run", name, "--plan"]) == 2
        said = capsys.readouterr().err
        assert str(one) in said and str(other) in said


@pytest.mark.survives("same name")
def test_a_registered_case_is_named_like_its_file(plugins, capsys):
    path = case_file(plugins["cases"], name="tide")
    path.rename(path.with_name("zz_other.py"))
    assert main(["run", "zz_other", "--plan"]) == 2
    said = capsys.readouterr().err
    assert "'tide'" in said and "zz_other.py" in said


@pytest.mark.survives("same name")
@pytest.mark.parametrize("second", ["scene", "SCENE"])
def test_two_case_files_of_one_name_are_an_error_with_both_files(tmp_path, capsys, second):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    one = case_file(tmp_path / "a")
    other = case_file(tmp_path / "b", name=second)
    assert (
        main(
            [
                "run",
                "--cases",
                str(one),
                "--cases",
                str(other),
                "-s",
                "pbd",
                "-o",
                str(tmp_path / "r"),
            ]
        )
        == 2
    )
    said = capsys.readouterr().err
    assert str(one) in said and str(other) in said and not (tmp_path / "r").exists()
    with pytest.raises(ValueError, match="alike"):
        nsbench.run([nsbench.load_case(one), nsbench.load_case(one)], "pbd", h=0.1)


@pytest.mark.survives("same name")
@pytest.mark.parametrize(
    "first, second", [("twin", "twin"), ("twin", "Twin"), (None, "pbd"), (None, "PBD")]
)
def test_two_solver_files_of_one_name_are_an_error_with_both_files(tmp_path, capsys, first, second):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    files = [solver(tmp_path / "a", first)] if first else []
    files += [solver(tmp_path / "b", second)]
    args = [a for f in files for a in ("--solvers", str(f))]
    assert main(["run", "tide", *args, "-o", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert str(files[-1]) in said and (str(files[0]) if first else "solvers/pbd/method.py") in said


NASTY = [
    "<script>alert(1)</script>",
    "=cmd()",
    "\x1b[31mred",
    "../../etc/passwd",
    "a\nb",
    "x" * 300,
    "",
    "a b",
    "é",
]


@pytest.mark.survives("names")
@pytest.mark.parametrize("name", NASTY)
def test_a_case_is_not_named_like_that(tmp_path, capsys, name):
    path = tmp_path / "c.py"
    path.write_text(case_file(tmp_path, name="plain").read_text().replace("'plain'", repr(name)))
    assert main(["run", "--cases", str(path), "-s", "pbd", "-o", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert repr(name)[:60].rstrip("'") in said.replace("\\\\", "\\") and len(said) < 1000
    assert not re.search(r"[\x00-\x09\x0b-\x1f]", said) and said.count("\n") == 1


@pytest.mark.survives("names")
@pytest.mark.parametrize("name", [n for n in NASTY if "/" not in n and n and len(n) < 200])
def test_a_solver_file_is_not_named_like_that(tmp_path, capsys, name):
    path = solver(tmp_path, name)
    for args in (
        ["run", "tide", "--solvers", str(path), "-o", str(tmp_path / "r")],
        ["run", "tide", "-s", name],
    ):
        assert main(args) == 2
        said = capsys.readouterr().err
        assert not re.search(r"[\x00-\x09\x0b-\x1f]", said) and said.count("\n") == 1


@pytest.mark.survives("names")
def test_what_a_run_says_cannot_command_a_terminal(tmp_path, capsys):
    path = case_file(tmp_path)
    path.write_text(
        path.read_text() + "\nraise ValueError('\\x1b]0;owned\\x07 \\x9b31m \\u202e')\n"
    )
    assert main(["run", "--cases", str(path)]) == 2
    said = capsys.readouterr().err
    assert "owned" in said and not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", said)


@pytest.mark.survives("nearest name")
@pytest.mark.parametrize(
    "args, said",
    [
        (["run", "three_disc"], "'three_discs'"),
        (["run", "discs[sed=3]"], "'seed'"),
        (["run", "tide", "-s", "catchingup"], "'catching_up'"),
        (["run", "tide", "-s", "pbd[sweps=2]"], "'sweeps'"),
        (["run", "tide", "-s", "catching_up[backend=osqq]"], "'osqp'"),
        (["reference", "verify", "three_disks"], "'three_discs'"),
        (["show", "tied"], "'tide'"),
    ],
)
def test_unknown_names_come_with_the_nearest(args, said, capsys):
    assert main(args) == 2
    assert f"did you mean {said}" in capsys.readouterr().err


@pytest.mark.survives("nothing matches")
@pytest.mark.parametrize(
    "args",
    [["--tag", "no-such-tag"], ["tide", "--tag", "zeno"], ["--suite", "smoke", "--tag", "zeno"]],
)
def test_a_filter_that_leaves_nothing_is_an_error(args, capsys):
    assert main(["run", *args]) == 2
    assert "no case matches" in capsys.readouterr().err


@pytest.mark.survives("not picklable")
def test_what_cannot_be_pickled_runs_because_it_travels_by_name(tmp_path):
    """A lock and closures in a case and in a solver; two workers, spawned."""
    text = (
        f"{HEAD}import threading\nLOCK = threading.Lock()\n\n\ndef drift(xp):\n    if xp is np:\n"
        "        with LOCK:\n            pass\n    return lambda t, x: -1.0 + 0 * x\n\n\n"
        "CASE = Case(name='{}', problem=Complementarity(drift, (Affine(np.eye(1), "
        "np.zeros(1)),)), x0=[1.0],\n"
        "            t=[0.0, 1, 2], params={{'lock': LOCK}})\n"
    )
    for name in ("one", "two"):
        (tmp_path / f"{name}.py").write_text(
            text.replace("{}", name).replace("{{", "{").replace("}}", "}")
        )
    method = solver(tmp_path, "locked", prepare="import threading; self_lock = threading.Lock()")
    args = [
        "run",
        "--cases",
        str(tmp_path / "one.py"),
        "--cases",
        str(tmp_path / "two.py"),
        "--solvers",
        str(method),
        "-j",
        "2",
        "-s",
        "pbd",
        "-s",
        "locked",
        "--h",
        "0.1",
        "-o",
        str(tmp_path / "r"),
    ]
    assert main(args) == 0
    assert (tmp_path / "r" / "runs.csv").read_text().count(",ok,") == 4


@pytest.mark.survives("not picklable")
def test_an_object_that_is_handed_over_is_what_runs():
    """Not the registered case of the same name."""
    tide = nsbench.get_case("tide")
    moved = tide.replace(x0=np.array([3.0]), exact=None, exact_impulse=None)
    row = nsbench.run([moved.replace(name="moved")], "pbd", h=0.1).rows[0]
    assert row["status"] == "ok" and np.isnan(row["state_sup"]) and row["reference"] == "none"
    row = nsbench.run([moved], "pbd", h=0.1).rows[0]
    assert row["status"] == "error" and "another version of tide" in row["why"]
    assert np.isfinite(nsbench.run([tide], "pbd", h=0.1).rows[0]["state_sup"])


@pytest.mark.survives("ok is finite", "own residuals")
def test_a_solver_cannot_speak_for_the_bench(tmp_path):
    """Whatever it counts, the columns of the bench are those of the bench."""
    from nsbench.study import Spec
    from nsbench.study.attempt import attempt

    lies = {
        "state_sup": 0.0,
        "residual": 0.0,
        "feasibility": 0.0,
        "status": "ok",
        "case": "other",
        "seconds": 0.0,
        "asked": 7.0,
        "why": "trust me",
        "solver": "other",
        "reference": "exact",
        "setup_seconds": -1.0,
        "rounds": 99,
        "mine": 5,
        "read": 5,
        "unlike": "all",
        "shared": True,
        "limit": 1e9,
        "warnings": 7,
    }
    path = solver(tmp_path, "liar", stats=repr(lies))
    row = attempt(Spec("tide", "liar", "h", 0.1, "", (str(path),)))[0]
    assert (
        row["case"] == "tide"
        and row["solver"] == "liar"
        and row["asked"] == 0.1
        and row["why"] == ""
        and row["mine"] == 5
    )
    assert row["state_sup"] > 0.4 and row["residual"] > 0.4
    assert row["seconds"] > 0 and row["setup_seconds"] >= 0 and row["rounds"] < 99
    assert not {"read", "unlike", "shared", "limit", "warnings"} & row.keys()


@pytest.mark.survives("ok is finite")
@pytest.mark.parametrize(
    "change, word",
    [
        ({"t": lambda t: t[:-1], "x": lambda x: x[:-1]}, "times"),
        ({"x": lambda x: x[:-1]}, "shape"),
        ({"x": lambda x: np.where(x > 0.4, np.nan, x)}, "not finite"),
        ({"x": lambda x: np.where(x > 0.4, np.inf, x)}, "not finite"),
        ({"t": lambda t: 0.5 * t}, "times"),
        ({"x": lambda x: x.astype(np.float32)}, "float32"),
        ({"x": lambda x: x.astype(complex)}, "complex"),
        ({"reaction": lambda r: r + np.nan}, "reaction"),
        ({"reaction": lambda r: r[:-1]}, "reaction"),
    ],
)
def test_a_row_that_says_ok_and_has_not_reached_its_end_is_an_error(change, word):
    case = nsbench.get_case("tide")
    good = nsbench.solve(case, "pbd", h=0.05)
    parts = {
        n: change.get(n, lambda v: v)(getattr(good, n))
        for n in ("t", "x", "contacts", "impulse", "reaction")
    }
    assert contract_violation(case, good) == "" and word in contract_violation(
        case, Trajectory(**parts)
    )


@pytest.mark.survives("closed list")
def test_every_status_is_one_of_the_list():
    for code in STATUSES:
        assert Status(code, "A sentence.").code == code
    for code in ("OK", "good", "", None, "ok "):
        with pytest.raises((ValueError, TypeError)):
            Status(code)
    for spec in METHODS:
        for name in ("tide", "sliding", "hex", "inconsistent", "spiral", "rlc_diode"):
            traj = nsbench.solve(name, spec)
            assert traj.status.code in STATUSES and (
                traj.status.ok or len(str(traj.status).split()) > 4
            )


@pytest.mark.survives("same bytes")
@pytest.mark.parametrize("spec", METHODS)
def test_a_run_repeated_gives_the_same_bytes(spec):
    for name in ("tide", "three_discs"):
        if solvers.get(spec).refuses(nsbench.get_case(name)) is None:
            a = nsbench.solve(name, spec)
            b = nsbench.solve(nsbench.get_case(name), spec)
            for part in ("t", "x", "impulse", "reaction"):
                assert getattr(a, part).tobytes() == getattr(b, part).tobytes(), (spec, name, part)
            told = [repr(nsbench.errors(nsbench.get_case(name), traj)) for traj in (a, b)]
            assert told[0] == told[1]
