"""Implicit Euler solves its step where surfaces meet, monotone or not, or says that it did not."""

import numpy as np
import pytest

from nsbench import Case, Filippov, solve

IMPLICIT = "euler[implicit=true]"
H = 0.02


def corner(xp):
    return lambda t, x: x[:3] + 0.0


def eight_fields(xp):
    """Constant fields by octant, kept in the state so that one compiled function serves all."""

    def f(t, x, s):
        out = 0.0 * x
        for q in range(8):
            w = 1.0
            for i in range(3):
                w = w * 0.5 * (1.0 + (1.0 - 2.0 * ((q >> i) & 1)) * s[i])
            for j in range(3):
                out[j] += w * x[3 + 3 * q + j]
        return out

    return f


RANDOM = Filippov.signs(eight_fields, corner)


def defect(t, traj):
    """Largest violation of x+ = x + h F(x+, s), s_i in Sgn(c_i(x+)), put together from samples and
    weights."""
    F = RANDOM.field(np)
    worst = 0.0
    s = 2.0 * np.diff(traj.impulse, axis=0) / np.diff(t)[:, None] - 1.0
    for k, q in enumerate(s):
        y = traj.x[k + 1]
        side = np.where(np.abs(q) < 1 - 1e-9, np.abs(y[:3]), np.maximum(0.0, -y[:3] * np.sign(q)))
        worst = max(
            worst,
            np.abs(y - traj.x[k] - H * F(t[k + 1], y, q)).max(),
            np.abs(q).max() - 1.0,
            side.max(),
        )
    return worst


# 95 and 115: Newton's method misses the only solution from the weights of the last step
@pytest.mark.long
@pytest.mark.parametrize("seed", [*range(30), 95, 115])
def test_random_fields_in_eight_octants(seed):
    """Each step is solved; the motion need not be the only one (seed 23: from t = 0.73 both fields
    leave surface 2)."""
    rng = np.random.default_rng(seed)
    x0 = np.concatenate((0.3 * rng.normal(size=3), rng.normal(size=24)))
    t = np.arange(0.0, 1.0001, H)
    traj = solve(Case("octants", RANDOM, x0, t, unique=False), IMPLICIT, h=H)
    assert traj.status.ok, traj.status
    assert defect(t, traj) < 1e-11


def test_the_check_would_notice():
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 1.0001, H)
    traj = solve(
        Case("octants", RANDOM, np.concatenate((0.3 * rng.normal(size=3), rng.normal(size=24))), t),
        IMPLICIT,
        h=H,
    )
    traj.x[20] += 1e-9
    assert defect(t, traj) > 1e-10


def test_a_step_without_a_solution_is_a_status():
    # x+ = x + h (x+)^2 + h has none for h > 1/2 from 0: nothing is returned in its place
    square = Filippov.signs(
        lambda xp: lambda t, x, s: 4.0 * x * x + 1.0 + 0.1 * s, lambda xp: lambda t, x: x - 5.0
    )
    traj = solve(Case("none", square, np.zeros(1), np.linspace(0.0, 2.0, 3)), IMPLICIT, h=1.0)
    assert (
        traj.status.code == "maxiter"
        and "smaller step" in str(traj.status)
        and np.isnan(traj.x[-1]).all()
    )


@pytest.mark.parametrize("shift, size", [(0.0, 1.0), (0.0, 1e-6), (1e8, 1.0), (-3e5, 1e-3)])
def test_which_side_a_step_ends_on_is_told_by_what_rounds_there(shift, size):
    """x' = -2 + s crosses x = shift, where c = (x - shift)^3 is flat, at once, and goes on at
    -3."""
    field = lambda xp: lambda t, x, s: xp.stack((-2.0 * size + size * s[0],))
    switch = lambda xp: lambda t, x: xp.stack(((x[0] - shift) ** 3,))
    case = Case(
        "flat",
        Filippov.signs(field, switch),
        np.array([shift + 1e-3 * size]),
        np.linspace(0.0, 1.0, 5),
    )
    run = solve(case, "euler[implicit=true]", h=0.01)
    assert run.status.ok
    assert run.x[-1, 0] - shift == pytest.approx(
        size * (1e-3 - 3.0), abs=0.1 * size + 1e-7 * (shift != 0.0)
    )
    assert run.impulse[-1, 0] < 0.06
