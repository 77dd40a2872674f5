"""`nsbench check` finds wrong methods and wrong cases, and says what is wrong with them."""

import re

import pytest

from nsbench.cli import main
from nsbench.cli.check import check_file, check_name

METHOD = '''"""Euler, then clipping at one floor per coordinate."""
from dataclasses import dataclass

import numpy as np

from nsbench.problem import Affine, Complementarity
from nsbench.solvers import Claims, Trajectory, grid


@dataclass(frozen=True)
class Clip:
    """Explicit Euler, then each coordinate clipped at its floor."""

    accuracy, default, claims = "h", 1e-2, Claims(state=1.0, impulse=1.0)

    def refuses(self, case):
        c = getattr(case.problem, "constraints", ())
        if len(c) != 1 or not isinstance(c[0], Affine) or c[0].moving or c[0].A.shape[0] != case.n:
            return "Clip needs one floor for every coordinate and nothing else."

    def prepare(self, case, h):
        g, f, rng = grid(case.t, h), case.problem.drift(np), np.random.default_rng(1)
        memory = np.zeros(case.n)

        def run():
            x, total, X, I = case.x0.copy(), np.zeros(case.n), [case.x0], [np.zeros(case.n)]
            for k, n in enumerate(g.substeps):
                step = (g.t[k + 1] - g.t[k]) / n
                for s in range(n):
                    y = x + step * f(g.t[k] + s * step, x)
                    x = np.maximum(y, 0.0)
                    push = x - y
                    total = total + push
                X.append(x)
                I.append(total)
            X, I, R = np.array(X), np.array(I), np.array(I)
            ids = tuple((0, i) for i in range(case.n))
            return Trajectory(case.t, X, ids, I, R, stats={"h": g.h}, lam_time="end")

        return run


SOLVER = Clip
'''
FINE = {
    "as it is": ("", ""),
    "sixty copies of a step": ("for s in range(n)", "for s in list(range(n))"),
}
WRONG_METHODS = {
    "multipliers of the wrong sign": ("total + push", "total - push", "opposite sign"),
    "no multipliers": ("total + push", "total", "all zero"),
    "twice the multipliers": ("total + push", "total + 2 * push", "2 times those"),
    "multipliers of the last step": ("I.append(total)", "I.append(push / step)", "multipliers"),
    "random multipliers": (
        "push = x - y", "push = rng.uniform(0, 2, 1) * (x - y)", "run is called again"
    ),
    "the same random multipliers again": (
        "push = x - y", "push = abs(np.sin(1e9 * (k + s / n))) * (x - y)", "times those of the cl"
    ),
    "random steps": (
        "x = np.maximum(y, 0.0)",
        "x = np.maximum(y + step * np.random.standard_normal(1), 0.0)",
        "no state kept",
    ),
    "half of the drift": ("x + step * f", "x + 0.5 * step * f", "state: order 1 is claimed"),
    "one per cent more drift": ("x + step * f", "x + 1.01 * step * f", "they level off"),
    "an order that is not there": ("state=1.0", "state=2.0", "order 2 is claimed.*of order 1"),
    "state that is kept": ("x = np.maximum(y, 0.0)", "memory[:] += 1e-3; x = np.maximum(y + memory, 0)", "called again"),
    "not a number": ("np.array(X), ", "np.array(X) * np.nan, ", "not finite"),
    "states for impulses": ("np.array(I), np.array(I)", "np.array(I)[:-1], 0", r"impulse is .*shape"),
    "a contact of another case": ("(0, i)", "(3, i)", r"id \(3, 0\), which is none"),
    "another start": ("[case.x0], [", "[case.x0 + 0.1], [", "begins with 0.6"),
    "a refusal without reason": ('return "Clip needs', 'return True or "Clip needs', "or a sent"),
    "nothing returned": ("return Traj", "Traj", "returned NoneType"),
    "steps of its own": ("grid(case.t, h)", "grid(case.t, 1e-2)", "multipliers|steps of"),
    "the floor is forgotten": ("np.maximum(y, 0.0)", "y", "state: order 1.*|all zero"),
    "a reaction of the other sign": (
        "np.array(I), np.array(I)", "np.array(I), -np.array(I)", "reaction: order 1 is claimed"
    ),
    "a reaction that is twice the impulses": (
        "np.array(I), np.array(I)", "np.array(I), 2 * np.array(I)", "reaction: order 1 .*level off"
    ),
    "no docs of the accuracy": ("accuracy, default", "exactness, default", "has no accuracy"),
}  # fmt: skip


def said_of(tmp_path, text, name="mine"):
    """Violations of a file, and what is said beside them."""
    path = tmp_path / f"{name}.py"
    path.write_text(text)
    said = []
    return check_file(path, said.append), said


@pytest.mark.parametrize("name", FINE)
def test_a_right_method_is_fine(tmp_path, name):
    old, new = FINE[name]
    violations, said = said_of(tmp_path, METHOD.replace(old, new))
    assert not violations and any("of order 1.0" in line for line in said), said


def test_a_method_of_which_nothing_can_be_measured_is_told_so(tmp_path):
    """It refuses all that has a closed form: nothing of it has run."""
    violations, said = said_of(tmp_path, METHOD.replace("if len(c) != 1 or", "if True or"))
    assert not violations and any("no error or order of it was measured" in line for line in said)


@pytest.mark.long
@pytest.mark.parametrize("name", WRONG_METHODS)
def test_a_wrong_method_is_found(tmp_path, name):
    old, new, sentence = WRONG_METHODS[name]
    assert old in METHOD
    violations, _ = said_of(tmp_path, METHOD.replace(old, new))
    assert violations and re.search(sentence, " ".join(violations)), violations


FIRST_LADDER = (2, 3, 5, 7, 11, 17, 27, 41, 64, 101)  # steps between two samples of tide


def test_a_claim_that_holds_is_not_judged_again_because_another_fails(tmp_path):
    """Multipliers that are right with the numbers of steps of the first ladder only.

    With a right claim of the state they are fine, and with a wrong one they are fine too.
    """
    text = METHOD.replace("push = x - y", f"push = (x - y) * (2 - (n in {FIRST_LADDER}))")
    assert not said_of(tmp_path, text, "right")[0]
    violations, said = said_of(tmp_path, text.replace("state=1.0", "state=2.0"), "wrong")
    assert [v.split(": ")[1] for v in violations] == ["state"], violations
    assert re.search("multipliers of order 1.0.* on 10 steps h from 0.025 to 0.0005;", said[-1])


def test_the_ladder_on_which_a_verdict_stands_is_named(tmp_path):
    (sentence,), said = said_of(tmp_path, METHOD.replace("state=1.0", "state=2.0"))
    last = "on 19 steps h from 0.025 to 0.00032 (the ladder of the standard suite"
    first = "10 steps h from 0.025 to 0.0005 contradict the claim"
    assert f"are of order 1.00 {last}; {first} too)" in sentence
    assert f"state of order 1.00 {last}, as {first})" in said[-1]


def test_errors_that_show_no_order_are_not_said_to_be_of_one(tmp_path):
    text = METHOD.replace("np.array(I), np.array(I)", "np.array(I), 2 * np.array(I)")
    (sentence,), said = said_of(tmp_path, text)
    no_order = "of no order: they level off (slope of the fit 0.00, not an order)"
    assert f"are {no_order}" in sentence and f"reaction {no_order}" in said[-1]


def test_a_method_of_a_file_is_checked_with_options(tmp_path):
    options = "share: float = 1.0\n    word: str = ''\n    is_on: bool = False\n    "
    options += "accuracy, default"
    text = METHOD.replace("accuracy, default", options)
    share = "(self.share if self.is_on and self.word == 'Ab' else 1.0)"
    path = tmp_path / "optional.py"
    path.write_text(text.replace("x + step * f", f"x + {share} * step * f"))
    half = "[share=0.5,word=Ab,is_on=true]"
    for options, right in (("", True), ("[share=0.5]", True), (half, False)):
        violations = check_name(f"{path}{options}", lambda line: None)
        assert bool(violations) != right, (options, violations)


CASE = '''"""A point pulled onto the floor by a growing force: y' = -t + lam, 0 <= y _|_ lam >= 0."""
import math, re
import numpy as np
from nsbench import Affine, Case, Complementarity, Filippov, Smooth

RNG = np.random.default_rng()
COUNT = []


def drift(xp):
    def f(t, y):
        return -t * xp.ones_like(y)
    return f


def g(xp):
    return lambda t, x: x * xp.exp(-t) + 0.0


FLOOR = Affine(A=np.eye(1), b=np.zeros(1))
CASE = Case(
    name="mine",
    problem=Complementarity(drift, (FLOOR,)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 2.0, 41),
    exact=lambda t: np.maximum(0.5 - t**2 / 2, 0.0)[:, None],
    exact_impulse=lambda t: (np.maximum(t, 1.0) ** 2 / 2 - 0.5)[:, None],
    exact_events=(1.0,),
)
'''
DRIFT = "return -t * xp.ones_like(y)"
WRONG_CASES = {
    "not a number at the start": (
        DRIFT, "return -t * xp.log(y - 1.0)", "drift is nan at the start, t = 0"
    ),
    "not a number later": (DRIFT, "return -t * xp.sqrt(1.0 - t) + 0 * y", "nan at the feasible t ="),
    "random force": (DRIFT, "return -t * xp.ones_like(y) * RNG.uniform(1, 2)", "two values"),
    "random start": ("np.array([0.5])", "RNG.uniform(0, 1, 1)", "x0 differs when the file"),
    "a counter in the drift": (
        DRIFT, "COUNT.append(1); return -t * xp.ones_like(y) * len(COUNT)", "two values"
    ),
    "exact solution of the wrong sign": ("t**2 / 2, 0", "t**2, 0", r"differs from exact\(t\)"),
    "half the exact impulse": ("** 2 / 2 - 0.5)", "** 2 / 4 - 0.25)", "from exact_impulse"),
    "decreasing impulse": ("(np.maximum(t, 1.0) ** 2 / 2 - 0.5)", "(-t)", "impulse decreases"),
    "an event elsewhere": ("(1.0,)", "(1.5,)", "exact_events"),
    "start below the floor": ("np.array([0.5])", "np.array([-0.5])", "start|x0"),
    "exact solution of another start": ("np.array([0.5])", "np.array([0.6])", r"exact\(t0\) is"),
    "no description": ('"""A point', 'X = """A point', "no docstring"),
    "functions of math": (
        DRIFT, "return -math.sin(y[0]) * xp.ones_like(y)", "JAX cannot run.*line 12.*xp.sin"
    ),
    "a branch of Python": (DRIFT, "return -y if y[0] > 9 else -t * y", "JAX.*xp.where"),
    "a regular expression in the drift": (
        DRIFT,
        "return -t * xp.ones_like(y) * len(re.sub('a', 'b', 'a'))",
        "numba cannot compile the drift.*'sub'.*line 12",
    ),
    "a suite of unknown parameters": (
        "CASE = Case(", "SUITES = {'full': [{'mu': 1.0}]}\nCASE = Case(", "no parameters.*mu"
    ),
    "a wrong gradient": (
        "(FLOOR,)", "(Smooth(g, gradient=lambda xp: lambda t, x: 2 * xp.eye(1)),)", "gradient diff"
    ),
    "a wrong rate": ("(FLOOR,)", "(Smooth(g, rate=lambda xp: lambda t, x: 0 * x),)", "rate diff"),
    "a gap that is not finite": (
        "(FLOOR,)", "(Smooth(lambda xp: lambda t, x: xp.log(x - 0.5)),)", "start|g is -inf"
    ),
    "a wall that is not finite": (
        "b=np.zeros(1)", "b=lambda xp: lambda t: 1 / xp.array([t])", "b is inf at the start|not fin"
    ),
    "an index that is there at the start only": (
        DRIFT, "return -t * xp.ones_like(y) * [1.0, 2.0][int(t > 0)] if t < 0.1 else [][1]",
        "drift fails at the feasible t = .*line 12 .*IndexError",
    ),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", WRONG_CASES)
def test_a_wrong_case_is_found(tmp_path, name):
    old, new, sentence = WRONG_CASES[name]
    assert old in CASE
    violations, _ = said_of(tmp_path, CASE.replace(old, new))
    assert violations and re.search(sentence, " ".join(violations)), violations


def test_a_right_case_is_fine_and_its_fast_path_is_named(tmp_path):
    violations, said = said_of(tmp_path, CASE)
    assert not violations
    assert any("event_driven: " in line and "proven" in line for line in said), said


@pytest.mark.long
def test_registered_names_are_checked_as_files_are(capsys):
    assert main(["check", "sliding"]) == 0
    assert "sliding: fine" in capsys.readouterr().out
    assert main(["check", "euler[implicit=true]"]) == 0
    assert "friction: state of order" in capsys.readouterr().out


def test_a_case_of_a_file_is_checked_with_its_parameters(tmp_path, capsys):
    """x' = -1, x >= b: with b = 2 the start x = 1 violates the constraint."""
    file = tmp_path / "floor.py"
    file.write_text(
        '"""x\' = -1, x >= b"""\n'
        "import numpy as np\n"
        "from nsbench import Affine, Case, Complementarity\n\n\n"
        "def make(b: float = 0.0):\n"
        "    drift = lambda xp: lambda t, x: 0.0 * x - 1.0\n"
        "    floor = Affine(np.eye(1), np.array([-b]))\n"
        "    problem = Complementarity(drift, (floor,))\n"
        "    return Case('floor', problem, np.ones(1), np.linspace(0, 2, 9))\n"
    )
    assert main(["check", str(file)]) == 0
    assert main(["check", f"{file}[b=0.5]"]) == 0
    assert "floor[b=0.5]" in capsys.readouterr().out
    assert main(["check", f"{file}[b=2.0]"]) == 3
    assert main(["check", f"{file}[c=2.0]"]) == 3
    assert "1 point to correct" in capsys.readouterr().out


def test_several_names_are_checked_and_one_that_is_wrong_counts(tmp_path, capsys):
    path = tmp_path / "own.py"
    path.write_text("CASE = 3\n")
    assert main(["check", str(path), "apple"]) == 3
    said = capsys.readouterr().out
    assert f"{path}: 1 point to correct" in said and "apple: fine" in said
    assert main(["check", "apple", "tide"]) == 0
