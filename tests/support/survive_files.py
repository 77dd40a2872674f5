"""Case files for tests of what is survived, and the rows of their runs."""

from nsbench.cli import main
from nsbench.solvers import get
from nsbench.study import Spec
from nsbench.study.attempt import attempt
from nsbench.study.plan import resolve

METHODS = ("pbd", "catching_up", "kdtree", "event_driven", "theta", "penalty")
HEAD = (
    '"""A scene that was made for a test."""\nimport numpy as np\nfrom nsbench import *\nfrom '
    "nsbench import Case\n\n"
)
FLOOR = "Affine(np.eye(1), np.zeros(1)),"


def case_file(
    folder,
    drift="-1.0 + 0 * x",
    constraints=FLOOR,
    x0="[1.0]",
    t="np.linspace(0, 2, 11)",
    name="scene",
    more="",
    problem=None,
):
    """A file with one case; drift: what f(t, x) returns."""
    path = folder / f"{name}.py"
    problem = problem or f"Complementarity(drift, ({constraints}))"
    path.write_text(
        f"{HEAD}\ndef drift(xp):\n    return lambda t, x: {drift}\n\n\n"
        f"CASE = Case(name={name!r}, problem={problem}, x0={x0}, "
        f"t={t}{', ' if more else ''}{more})\n"
    )
    return path


def rows(path, methods=METHODS, **accuracy):
    """Rows by method, those that refuse the case left out. accuracy: of all methods with that
    parameter."""
    out = {}
    for spec in methods:
        method = get(spec)
        asked = accuracy.get(method.accuracy, method.default)
        row = attempt(Spec(path.stem, spec, method.accuracy, asked, str(path)))[0]
        if row["status"] != "refused":
            out[spec] = row
    resolve.cache_clear()
    return out


def refused_before(path, folder, capsys, *args):
    """What the command line says of a case file that it does not run; nothing may have been
    written."""
    out = folder / "never"
    assert main(["run", "--cases", str(path), "-s", "pbd", "-o", str(out), *args]) == 2
    assert not out.exists()
    return capsys.readouterr().err
