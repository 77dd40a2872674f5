"""A wrong case file is reported with file, line, field and remedy."""

import re

import numpy as np
import pytest

import nsbench
from nsbench.cli import main

FILE = '''"""A point between a force and a floor."""
import numpy as np
from nsbench import LCS, Affine, Case, Complementarity, Distance, Filippov, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([-x[1], x[0]])
    return f


def other(xp):
    def f(t, x):
        return xp.array([x[1], -x[0]])
    return f


def switch(xp):
    def c(t, x):
        return xp.array([x[0]])
    return c


FLOOR = Affine(A=np.eye(2)[:1], b=np.zeros(1))
CASE = Case(
    name="mine",
    problem=Complementarity(drift, (FLOOR,)),
    x0=np.array([0.5, 0.0]),
    t=np.linspace(0.0, 1.0, 11),
)
'''
PROBLEM = "Complementarity(drift, (FLOOR,))"
DRIFT = "return xp.array([-x[1], x[0]])"

# name: what is replaced, by what, the text of the line that is named (None: none), the sentence
WRONG = {
    "tuple forgotten": (
        "(drift, (FLOOR,))", "(drift, FLOOR)", "problem=", r"tuple of families.*comma"
    ),
    "drift without factory": (
        f"def drift(xp):\n    def f(t, x):\n        {DRIFT}\n    return f",
        "def drift(t, x):\n    return -x",
        "problem=",
        r"drift must be a factory .*drift takes \(t, x\).*return f",
    ),
    "switch without factory": (
        PROBLEM,
        "Filippov({+1: drift, -1: other}, lambda t, x: x[:1])",
        "problem=",
        r"switch must be a factory.*return c",
    ),
    "drift is an array": (PROBLEM, "Complementarity(np.ones(2))", "problem=", "drift must be a f"),
    "field misspelt": ("x0=np", "x_0=np", "CASE = Case(", "no field 'x_0'; did you mean 'x0'"),
    "field of a family misspelt": (
        "Affine(A=", "Affine(a=", "FLOOR =", "Affine has no field 'a'; did you mean|there are"
    ),
    "field missing": (
        "    t=np.linspace(0.0, 1.0, 11),\n", "", "CASE = Case(", r"Case lacks 't'.*t=\.\.\."
    ),
    "field given twice": (
        "Affine(A=np.eye(2)[:1], b", "Affine(np.eye(2)[:1], A=1, b", "FLOOR", "'A' twice"
    ),
    "modes as a list": (
        PROBLEM, "Filippov([drift, other], switch)", "problem=", r"modes is list.*\{\+1: f_plus"
    ),
    "modes with a zero": (
        PROBLEM, "Filippov({1: drift, 0: other}, switch)", "problem=", r"key 0;.*\+1 or -1"
    ),
    "one mode of two": (PROBLEM, "Filippov({1: drift}, switch)", "problem=", "1 surface need"),
    "mode without factory": (
        PROBLEM,
        "Filippov({1: drift, -1: lambda t, x: x}, switch)",
        "problem=",
        r"modes\[\(-1,\)\] must be a factory",
    ),
    "modes for one surface, two switches": (
        PROBLEM,
        "Filippov({1: drift, -1: other}, lambda xp: lambda t, x: x)",
        "CASE = Case(",
        "switch of mine returns 2 values.*1 surface",
    ),
    "switch is a number": (
        PROBLEM,
        "Filippov({1: drift, -1: other}, lambda xp: lambda t, x: x[0])",
        "CASE = Case(",
        r"switch of mine returns float64 of shape \(\).*xp.array",
    ),
    "index too large": (
        DRIFT, "return xp.array([x[2], x[0]])", "x[2]", r"drift of mine.*x has 2 entries.*IndexErr"
    ),
    "shapes that cannot be broadcast": (
        DRIFT, "return x * np.ones(3)", "np.ones(3)", "drift of mine.*2 entries.*broadcast"
    ),
    "factory returns nothing": (
        f"{DRIFT}\n    return f", DRIFT, "CASE = Case(", "factory that returns NoneType.*`return f`"
    ),
    "drift returns nothing": (DRIFT, "x[0]", "CASE = Case(", "drift of mine returns None.*return"),
    "drift of another shape": (DRIFT, "return x[:1]", "CASE = Case(", r"shape \(1,\).*\(2,\)"),
    "drift in single precision": (DRIFT, "return np.float32(x)", "CASE = Case(", "returns float32"),
    "drift in integers": (DRIFT, "return np.array([1, 0])", "CASE = Case(", "int64.*float64"),
    "drift changes the state": (DRIFT, "x += 1.0; return x * 1.0", "CASE = Case(", "in place"),
    "function that numpy lacks": (
        DRIFT, "return xp.sinn(x)", "xp.sinn", "drift of mine.*did you mean 'sin'"
    ),
    "name from nowhere": (DRIFT, "return mu * x", "mu * x", "NameError: name 'mu'"),
    "b does not fit A": ("b=np.zeros(1)", "b=np.zeros(3)", "FLOOR", r"b has shape \(3,\).*1 row"),
    "A does not fit the state": ("np.eye(2)[:1]", "np.eye(3)[:1]", "CASE =", "A of mine has 3 col"),
    "moving wall of another shape": (
        "b=np.zeros(1)", "b=lambda xp: lambda t: np.zeros(2)", "CASE =", r"b of mine.*\(2,\).*\(1,"
    ),
    "moving wall without factory": (
        "b=np.zeros(1)", "b=lambda: np.zeros(1)", "FLOOR", "b must be a factory.*return b"
    ),
    "start of two dimensions": ("np.array([0.5, 0.0])", "np.eye(2)", "CASE =", "x0 of mine has sha"),
    "start in single precision": ("0.0])", "0.0], 'f')", "CASE =", "x0 of mine is float32"),
    "start that is a text": ("np.array([0.5, 0.0])", "'left'", "CASE =", "x0 of mine has dtype"),
    "times that decrease": ("0.0, 1.0, 11", "1.0, 0.0, 11", "CASE =", "t of mine must increase"),
    "policy misspelt": ("11),\n", "11),\n    start='projekt',\n", "CASE =", "mean 'project'"),
    "name with a blank": ('"mine"', '"my case"', "CASE =", "case name 'my case'"),
    "problem is the drift": (PROBLEM, "drift", "CASE =", "problem of mine is function"),
    "units as a tuple": ("11),\n", "11),\n    scale=(1.0, 1.0),\n", "CASE =", r"Scale\(time, st"),
    "particle that is not there": (
        "(FLOOR,)", "(Distance(1.0, pairs=[(0, 7)]),)", "CASE =", "particle 7; the state holds 1"
    ),
    "gap that is a number": (
        "(FLOOR,)", "(Smooth(lambda xp: lambda t, x: x[0]),)", "CASE =", r"g of mine.*\(m,\)"
    ),
    "matrices that do not fit": (
        PROBLEM, "LCS(np.eye(2), np.eye(2), np.eye(3), np.eye(2))", "problem=", "shapes do not fit"
    ),
    "input without factory": (
        PROBLEM,
        "LCS(*[np.eye(2)] * 4, u=lambda t, x: x)",
        "problem=",
        r"u must be a factory.*return u",
    ),
    "syntax": ("CASE = Case(", "CASE = Case((", "CASE = Case((", "SyntaxError"),
    "library that is not installed": (
        "import numpy as np", "import nunpy as np", "import nunpy", "nunpy.*install it"
    ),
    "class misspelt": ("Smooth\n", "Smoth\n", "Smoth", "did you mean 'Smooth'"),
    "data file that is not there": (
        "x0=np.array([0.5, 0.0])", "x0=np.loadtxt('gone.txt')", "x0=", "gone.txt"
    ),
    "neither CASE nor make": ("CASE = Case(", "case = Case(", None, "neither CASE"),
    "CASE is a problem": ("CASE = Case(", f"CASE = {PROBLEM}\n_ = Case(", None, "CASE of .*Compl"),
    "make returns nothing": ("CASE = Case(", "def make():\n  Case(", None, "returns NoneType.*retur"),
    "make fails": (
        "CASE = Case(", "def make():\n  return [][3]\n_ = Case(", "[][3]", "IndexError: list index"
    ),
}  # fmt: skip


def line_of(text, part):
    return next(k for k, line in enumerate(text.splitlines(), 1) if part in line)


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_case_file_is_reported_with_line_field_and_remedy(tmp_path, name):
    """Where a call spans several lines, Python names one of them: the field or the call."""
    old, new, place, sentence = WRONG[name]
    assert FILE.count(old) >= 1
    text = FILE.replace(old, new, 1)
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises((ValueError, TypeError)) as raised:
        nsbench.load_case(path)
    message = str(raised.value)
    assert str(path) in message
    assert re.search(sentence, message), message
    if place:
        line = line_of(text, place)
        assert f"line {line}" in message, message
    assert len(message) - len(str(path)) < 400


def test_modes_of_one_surface_may_have_bare_signs():
    def up(xp):
        return lambda t, x: xp.ones_like(x)

    def down(xp):
        return lambda t, x: -xp.ones_like(x)

    bare = nsbench.Filippov({+1: down, -1: up}, lambda xp: lambda t, x: x)
    assert set(bare.modes) == {(1,), (-1,)}
    case = nsbench.Case(name="relay", problem=bare, x0=[0.5], t=np.linspace(0, 1, 5))
    assert nsbench.solve(case, "euler", h=0.05).status.ok


def test_a_text_for_a_number_is_named_with_its_parameter():
    with pytest.raises(ValueError, match=r"parameter n of discs is 'abc'; a number is needed"):
        nsbench.get_case("discs[n=abc]")


def test_a_name_like_no_other_lists_a_few(capsys):
    assert main(["show", "qqqqqq"]) == 2
    message = capsys.readouterr().err
    assert "nsbench list" in message and len(message) < 300


@pytest.mark.parametrize("word", ["solver", "solvers", "case", "metric"])
def test_list_takes_a_kind_in_the_singular(word, capsys):
    assert main(["list", word]) == 0
    assert capsys.readouterr().out


def test_the_remedy_for_a_module_that_is_not_found_is_one(tmp_path, monkeypatch):
    """Python looks for modules where PYTHONPATH says, and not beside a file that is loaded."""
    file = tmp_path / "mine.py"
    file.write_text("from forces_of_mine import CASE")
    (tmp_path / "forces_of_mine.py").write_text(
        "import nsbench\nCASE = nsbench.get_case('tide').replace(name='mine')\n"
    )
    with pytest.raises(ValueError, match="name the folder that holds it in PYTHONPATH"):
        nsbench.load_case(file)
    monkeypatch.syspath_prepend(tmp_path)
    assert nsbench.load_case(file).name == "mine"
