"""The relay's events and states are those of its matrix exponentials, evaluated in 40 digits arc by
arc."""

import numpy as np
import pytest

from nsbench import get_case, solve

mp = pytest.importorskip("mpmath").mp


def digits(case, kinds, times):
    """Events polished by Newton's method and states at the samples; kinds and first guesses of the
    times are given."""
    mp.dps = 40
    w = mp.mpf(25)
    xi = mp.mpf(1) / 20
    sigma = mp.mpf(1)
    A = mp.matrix([[-(2 * xi * w + 1), 1, 0], [-(2 * xi * w + w * w), 0, 1], [-w * w, 0, 0]])
    b = mp.matrix([1, -2 * sigma, 1])

    def matrix(s):
        """x' = M (x, 1) with the sign s, or sliding with s = x2 (None)."""
        M = mp.zeros(4)
        M[:3, :3] = A - b * mp.matrix([[0, 1, 0]]) if s is None else A
        M[:3, 3] = mp.zeros(3, 1) if s is None else -s * b
        return M

    t = mp.mpf(0)
    x = mp.matrix([mp.mpf(str(v)) for v in case.x0] + [1])
    s = None
    sample = 0
    events = []
    states = []
    room = []
    for kind, guess in [*zip(kinds, times, strict=True), ("end", case.t[-1])]:
        M = matrix(s)
        end = mp.mpf(guess)
        for _ in range(4 if kind != "end" else 0):
            y = mp.expm(M * (end - t)) * x
            g = y[0] if s is not None else abs(y[1]) - 1
            end -= g / ((M * y)[0] if s is not None else mp.sign(y[1]) * (M * y)[1])
        while sample < len(case.t) and case.t[sample] <= end:
            y = mp.expm(M * (mp.mpf(case.t[sample]) - t)) * x
            states.append([float(v) for v in y[:3]])
            room.append(float(1 - abs(y[1]) if s is None else s * y[0]))
            sample += 1
        x = mp.expm(M * (end - t)) * x
        t = end
        events.append(float(t))
        s = mp.sign(x[1]) if kind == "exit" else None
        x[0] = 0 if kind != "end" else x[0]
    return np.array(events[:-1]), np.array(states), np.array(room)


def test_the_relay_is_met_in_all_its_events():
    case = get_case("relay")
    traj = solve(case, "event_driven")
    assert traj.status.ok and len(traj.events) == 34
    times, states, room = digits(case, [e.kind for e in traj.events], [e.t for e in traj.events])
    assert room.min() > -1e-12, "a weight beyond its bounds, or a state on the wrong side"
    assert np.abs(np.array([e.t for e in traj.events]) - times).max() < 1e-10
    assert np.abs(traj.x - states).max() < 1e-10 * max(1.0, np.abs(states).max())
