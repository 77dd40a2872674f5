"""Systems derived a second time, by an integrator of their own, come out to ten digits with no
event missed or invented.

The truths are by the extrapolated midpoint rule at 45 digits, written without using the bench
(tests/independent). tests/studies/independent.py prints the errors.
"""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import nsbench

sys.path.append(str(Path(__file__).parents[1] / "independent"))

import truths


@pytest.mark.long
@pytest.mark.parametrize("name", truths.names())
def test_a_second_derivation_agrees(name):
    traj = nsbench.solve(truths.case(name), "event_driven")
    errors = truths.compare(traj, truths.truth(name))
    assert traj.status.ok, str(traj.status)
    assert not errors.missed and not errors.extra
    assert errors.state < 1e-10 and errors.impulse < 1e-9 and errors.event < 1e-9


def told(true, events=None, x=0.0, impulse=0.0):
    """The truth as a trajectory, off by x and impulse, with other events."""
    events = [
        SimpleNamespace(t=float(t), kind=kind, contact=c)
        for t, kind, c in (true.events if events is None else events)
    ]
    return SimpleNamespace(
        t=np.linspace(0.0, 10.0, len(true.x)),
        x=true.x + x,
        impulse=true.impulse + impulse,
        contacts=true.ids,
        events=events,
    )


def test_an_error_of_a_trajectory_is_seen():
    true = truths.truth("two_diodes_d0")
    (t, kind, c), *rest = true.events
    assert truths.compare(told(true), true) == truths.Errors(0.0, 0.0, 0.0, (), ())
    assert truths.compare(told(true, x=1e-9), true).state > 1e-10
    assert truths.compare(told(true, impulse=1e-8), true).impulse > 1e-9
    assert truths.compare(told(true, [(float(t) + 1e-8, kind, c), *rest]), true).event > 1e-9
    assert truths.compare(told(true, rest), true).missed == (float(t),)
    assert truths.compare(told(true, [*true.events, (float(t), kind, c)]), true).extra == (
        float(t),
    )
    assert truths.compare(told(true, [(float(t), "cross", c), *rest]), true).extra == (float(t),)


def test_every_system_has_a_truth_and_every_truth_a_system():
    assert truths.names() == sorted(path.stem for path in (truths.HERE / "cases").glob("*.py"))
    assert len(truths.names()) == 93
