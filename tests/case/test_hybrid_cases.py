"""Hybrid systems as cases: faults of their data are sentences, and a report shows their runs."""

import numpy as np
import pytest
from hybrid_systems import constant, level, thermostat

import nsbench
from nsbench import Case, Hybrid, Transition
from nsbench.reference import build

STILL = constant(0.0)
LEAVE = Transition("on", level(0, 1.0), "on")


@pytest.mark.parametrize(
    "make, words",
    (
        (lambda: Hybrid([STILL], ()), "dict from names to drifts"),
        (lambda: Hybrid({"on": 3.0}, ()), "modes['on'] must be a factory"),
        (lambda: Hybrid({"on": STILL}, LEAVE), "a tuple of them is needed"),
        (lambda: Hybrid({"on": STILL}, (3.0,)), "transition 0 is 3.0"),
        (lambda: Hybrid({"one": STILL}, (LEAVE,)), "source of transition 0 is 'on', no mode; did"),
        (lambda: Hybrid({"on": STILL}, (), "off"), "initial is 'off', no mode"),
        (lambda: Transition("on", level(0, 1.0), "on", direction=0), "direction is 0"),
        (lambda: Transition("on", 3.0, "on"), "guard must be a factory"),
        (lambda: Transition("on", level(0, 1.0), "on", 3.0), "reset must be a factory"),
    ),
)
def test_data_that_do_not_fit_are_named(make, words):
    with pytest.raises((TypeError, ValueError)) as e:
        make()
    assert words in str(e.value)


@pytest.mark.parametrize(
    "modes, transition, words",
    (
        ({"on": constant(0.0, 0.0)}, LEAVE, "modes['on'] of wrong returns float64 of shape (2,)"),
        (
            {"on": STILL},
            Transition("on", lambda xp: lambda t, x: xp.array([1.0, 2.0]), "on"),
            "guard of transition 0 of wrong returns float64 of shape (2,)",
        ),
        (
            {"on": STILL},
            Transition("on", level(0, 1.0), "on", lambda xp: lambda t, x: 1.0),
            "reset of transition 0 of wrong returns float64 of shape ()",
        ),
    ),
)
def test_functions_of_the_wrong_shape_are_named(modes, transition, words):
    with pytest.raises(ValueError) as e:
        Case("wrong", Hybrid(modes, (transition,)), np.zeros(1), np.linspace(0.0, 1.0, 3))
    assert words in str(e.value)


def test_a_reference_is_two_integrators_and_a_witness(tmp_path):
    plain = thermostat(T=2.0)
    case = plain.replace(exact=None, exact_impulse=None, exact_events=None)
    ref = build(case, tmp_path)
    assert np.abs(ref.x - plain.exact(plain.t)).max() <= max(ref.state_error, 1e-12)
    assert np.abs(ref.impulse - plain.exact_impulse(plain.t)).max() <= max(ref.impulse_error, 1e-12)
    assert "euler comes from" in ref.how and "hybrid systems have no certificates" in ref.how


FILE = '''"""Two: on and off."""
import numpy as np
from nsbench import Case, Hybrid, Transition
up = lambda xp: lambda t, x: 1.0 + 0.0 * x
down = lambda xp: lambda t, x: -1.0 + 0.0 * x
CASE = Case("two", Hybrid({"up": up, "down": down}, (
    Transition("up", lambda xp: lambda t, x: x[0] - 1.0, "down"),
    Transition("down", lambda xp: lambda t, x: -x[0], "up"),
)), np.zeros(1), np.linspace(0.0, 3.3, 12), exact=lambda t: np.abs((t + 1) % 2 - 1)[:, None])
'''


def test_a_report_shows_its_runs_and_refusals(tmp_path):
    (tmp_path / "two.py").write_text(FILE)
    case = nsbench.load_case(tmp_path / "two.py")
    study = nsbench.run([case], ["event_driven", "euler", "pbd"], h=[0.1, 0.05, 0.025])
    rows = {(r["solver"], r["status"]) for r in study.rows}
    assert rows == {("event_driven", "below_reference"), ("euler", "ok"), ("pbd", "refused")}
    nsbench.write_report(study, tmp_path / "out.html")
    page = (tmp_path / "out.html").read_text()
    assert "Hybrid" in page and "this case is a hybrid system" in page
