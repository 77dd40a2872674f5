"""Event-driven on linear complementarity systems: closed forms to rounding, no double switch
missed, honest endings."""

import mpmath as mp
import numpy as np
import pytest
from nsbench.cases import rlc_diode

import nsbench
from nsbench import LCS, Case, get_case, solve

ONE = [[1.0]]
NONE = [[0.0]]


def system(A, B, C, D, x0, T, samples=61, u=None, q=None, **known):
    return Case(
        "system",
        LCS(A, B, C, D, u=u, q=q),
        np.array(x0, float),
        np.linspace(0.0, T, samples),
        **known,
    )


@pytest.mark.parametrize(
    "key, state", [("rlc_diode", 1e-12), ("diode_bridge", 1e-12), ("relay_lcs", 1e-12)]
)
def test_catalogue_to_rounding(key, state):
    case = get_case(key)
    traj = solve(case, "event_driven")
    e = nsbench.errors(case, traj)
    assert (
        traj.status.ok
        and e["state_sup"] <= state
        and e["impulse"] <= 1e-12
        and e["reaction"] <= 1e-12
    )
    assert (
        e["event_time"] <= 1e-12 * case.t[-1] * 10
        and e["events_missed"] == 0
        and e["events_extra"] == 0
    )
    assert max(e["residual"], e["feasibility"], e["complementarity"]) < 1e-12 and e["sign"] > -1e-12


@pytest.mark.long
def test_other_integrators_agree():
    for key in ("rlc_diode", "relay_lcs"):
        case = get_case(key)
        a = solve(case, "event_driven")
        b = solve(case, "event_driven[method=rk45]", tol=1e-10)
        assert b.status.ok and np.abs(a.x - b.x).max() <= 1e-7 * max(1.0, np.abs(a.x).max()), key
        assert [(e.kind, e.contact) for e in a.events] == [(e.kind, e.contact) for e in b.events]


@pytest.mark.long
def test_impulses_of_a_stiff_mode_are_as_near_as_its_states():
    """lam = -1000 (x + q): an error of x that the mode forgets at once is a thousand times as much
    of lam."""
    case = system(
        [[-1.0]],
        ONE,
        ONE,
        [[1e-3]],
        [0.3],
        1.0,
        5,
        q=lambda xp: lambda t: (-1.0 - 0.5 * xp.sin(3.0 * t)) * xp.ones(1),
    )
    a = solve(case, "event_driven")
    b = solve(case, "event_driven[method=rk45]", tol=1e-10)
    assert b.status.ok and np.abs(a.impulse - b.impulse).max() <= 0.5e-10


def test_switches_of_the_diode_in_thirty_digits():
    """Each arc anew by matrix exponentials and Newton's method on the voltage, in 40 digits."""
    mp.mp.dps = 40
    L = mp.mpf("1e-2")
    C = mp.mpf("1e-6")
    R = mp.mpf("1e3")
    on, off = (mp.matrix([[-g / (R * C), -1 / C], [1 / L, 0]]) for g in (1, 0))
    case = get_case("rlc_diode")
    events = [e.t for e in solve(case, "event_driven").events]
    x = mp.matrix([10, 0])
    t = mp.mpf(0)
    for k, guess in enumerate(case.exact_events):
        M = on if k % 2 == 0 else off
        tau = mp.mpf(guess) - t
        for _ in range(4):
            y = mp.expm(M * tau) * x
            tau -= y[0] / (M * y)[0]
        x = mp.expm(M * tau) * x
        t = t + tau
        assert abs(x[0]) < mp.mpf("1e-33")
        assert (
            abs(guess - t) < 4e-18 and abs(events[k] - t) < 1e-17
        )  # a rounding of each arc, at 5e-3
        assert np.abs(case.exact(np.array([guess]))[0, 1] - float(x[1])) < 1e-15
    assert (
        len(case.exact_events) == 16
        and rlc_diode.make(T=1e-3).exact_events == case.exact_events[:3]
    )


def rectifier(R=2.0, r=0.0, T=6.0):
    """Capacitor of 1 behind a diode with resistance r, fed by sin 3t: w = r lam + x - sin 3t, x' =
    -x/R + lam."""
    return system(
        [[-1 / R]], ONE, ONE, [[r]], [0.0], T, q=lambda xp: lambda t: -xp.sin(3.0 * t) * xp.ones(1)
    )


def test_ideal_rectifier():
    """D = 0: while it conducts x = sin 3t, lam = 3 cos 3t + x/R needs q'; it lets go at tan 3t =
    -3R."""
    mp.mp.dps = 30
    R = mp.mpf(2)
    traj = solve(rectifier(), "event_driven")
    release = []
    contact = []
    for k in range(3):
        t1 = (mp.pi - mp.atan(3 * R) + 2 * mp.pi * k) / 3
        release.append(t1)
        contact.append(
            mp.findroot(
                lambda t, t1=t1: mp.sin(3 * t1) * mp.exp(-(t - t1) / R) - mp.sin(3 * t), t1 + 1.66
            )
        )
    want = sorted(release + contact[:2])
    assert [e.kind for e in traj.events] == ["release", "contact", "release", "contact", "release"]
    assert max(abs(e.t - w) for e, w in zip(traj.events, want, strict=True)) < 1e-14
    want_x = []
    want_p = []
    total = mp.mpf(0)
    start = mp.mpf(0)
    edges = [(mp.mpf(0), release[0]), (contact[0], release[1]), (contact[1], release[2])]
    for t in map(mp.mpf, traj.t):
        arc = [e for e in edges if e[0] <= t][-1]
        grown = lambda a, b: (
            mp.sin(3 * b) - mp.sin(3 * a) - (mp.cos(3 * b) - mp.cos(3 * a)) / (3 * R)
        )
        held = min(t, arc[1])
        total = sum(grown(a, b) for a, b in edges[: edges.index(arc)]) + grown(arc[0], held)
        want_p.append(float(total - start))
        want_x.append(float(mp.sin(3 * held) * mp.exp(-(t - held) / R)))
    assert (
        np.abs(traj.x[:, 0] - want_x).max() < 1e-13
        and np.abs(traj.impulse[:, 0] - want_p).max() < 1e-13
    )


def test_stiff_rectifier_comes_close_to_the_ideal_one():
    far = [
        np.abs(solve(rectifier(r=r), "event_driven").x - solve(rectifier(), "event_driven").x).max()
        for r in (1e-4, 1e-7)
    ]
    assert far[0] == pytest.approx(1e3 * far[1], rel=0.01) and far[1] < 1e-6


@pytest.mark.parametrize("width", [1e-1, 1e-2, 1e-3, 2e-4])
def test_a_switch_there_and_back_inside_any_step_is_found(width):
    """w = lam + cos t + cos(width / 2) dips below zero for a time `width` around pi."""
    half = width / 2
    case = system(
        NONE,
        ONE,
        NONE,
        ONE,
        [0.0],
        6.0,
        7,
        q=lambda xp: lambda t: (xp.cos(t) + np.cos(half)) * xp.ones(1),
    )
    traj = solve(case, "event_driven")
    assert [e.kind for e in traj.events] == ["contact", "release"]
    assert np.allclose([e.t - np.pi for e in traj.events], [-half, half], rtol=0, atol=3e-15 / half)
    assert traj.x[-1, 0] == pytest.approx(2 * (np.sin(half) - half * np.cos(half)), abs=1e-15)


def test_diodes_in_parallel_share_one_reaction():
    push = lambda xp: lambda t: -xp.cos(t) * xp.ones(1)
    case = system(
        NONE,
        [[1.0, 1.0]],
        [[1.0], [1.0]],
        np.zeros((2, 2)),
        [0.0],
        3.0,
        u=push,
        exact=lambda t: np.where(t < np.pi / 2, 0.0, 1 - np.sin(t))[:, None],
        exact_events=(np.pi / 2,),
        exact_impulse=lambda t: 0.5 * np.sin(np.minimum(t, np.pi / 2))[:, None] * np.ones(2),
    )
    for spec, accuracy, limit in (
        ("event_driven", {}, 1e-13),
        ("theta[theta=0.5]", {"h": 1e-3}, 1e-6),
    ):
        e = nsbench.errors(case, solve(case, spec, **accuracy))
        assert e["multipliers_unique"] is False and np.isnan(e["impulse"])
        assert e["reaction"] < limit and e["state_sup"] < limit


def passive(seed, n=3, m=2):
    """B = C^T, D positive semidefinite of rank one, A stable, inputs that vary: unique motions,
    events of all kinds."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((n, n))
    C = rng.standard_normal((m, n))
    d = rng.standard_normal(m)
    A -= (0.3 + np.linalg.eigvalsh(0.5 * (A + A.T)).max()) * np.eye(n)
    phase = rng.uniform(0, 6, n)
    bias = rng.standard_normal(n)
    drive = lambda xp: lambda t: 2.0 * xp.sin(2.0 * t + phase) + bias
    q0 = rng.standard_normal(m)
    level = lambda xp: lambda t: q0 + 0.5 * xp.cos(3.0 * t) * xp.ones(m) + 0.1
    x0 = np.linalg.lstsq(C, 1.0 - q0, rcond=None)[0]  # w(0) = 1.6 > 0 with lam = 0
    return system(A, C.T, C, np.outer(d, d) * (seed % 2), x0, 4.0, 41, u=drive, q=level)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_random_passive_circuits_against_small_steps(seed):
    """Two methods without common code; the trapezoid comes closer with the square of its step."""
    case = passive(seed)
    traj = solve(case, "event_driven")
    assert traj.status.ok and traj.events
    far = []
    for h in (0.1 / 50, 0.1 / 200):
        steps = solve(case, "theta[theta=0.5]", h=h)
        far.append(
            max(np.abs(steps.x - traj.x).max(), np.abs(steps.reaction - traj.reaction).max())
        )
    assert far[1] < 2e-5 and far[1] < 0.2 * far[0]
    assert max(nsbench.errors(case, traj)[k] for k in ("feasibility", "complementarity")) < 1e-12


@pytest.mark.parametrize("push, x, lam", [(1.0, 2.0, 0.0), (-1.0, 0.0, 2.0)])
def test_where_lam_and_w_both_vanish_the_next_derivative_decides(push, x, lam):
    case = system(NONE, ONE, ONE, NONE, [0.0], 2.0, u=lambda xp: lambda t: push * t * xp.ones(1))
    traj = solve(case, "event_driven")
    assert traj.status.ok and traj.x[-1, 0] == pytest.approx(x, abs=1e-14)
    assert traj.impulse[-1].sum() == pytest.approx(lam, abs=1e-14)


def test_a_row_of_higher_index_may_rest_but_not_be_hit():
    ball = system(
        [[0, 1], [0, 0]],
        [[0], [1]],
        [[1, 0]],
        NONE,
        [0.0, 0.0],
        2.0,
        u=lambda xp: lambda t: xp.array([0.0, -1.0]),
    )
    traj = solve(ball, "event_driven")
    assert (
        traj.status.ok
        and np.abs(traj.x).max() < 1e-14
        and traj.impulse[-1, 0] == pytest.approx(2.0)
    )
    traj = solve(ball.replace(x0=np.array([0.5, 0.0])), "event_driven")
    assert (
        traj.status.code == "infeasible"
        and "jump" in str(traj.status)
        and "t = 1 " in str(traj.status)
    )


def test_no_solution_and_several_are_told():
    fall = lambda xp: lambda t: -xp.ones(1)
    traj = solve(system(NONE, [[-1.0]], ONE, NONE, [1.0], 2.0, u=fall), "event_driven")
    assert traj.status.code == "infeasible" and "t = 1 " in str(traj.status)
    traj = solve(system([[-1.0]], ONE, ONE, [[-1.0]], [1.0], 2.0), "event_driven")
    assert traj.status.code == "degenerate" and "several motions" in str(traj.status)
    assert solve("inconsistent", "event_driven").status.code == "refused"


def spiral():
    """x' = B s, s in Sgn(x) with relays as in relay_lcs: a spiral into the corner whose turns
    shrink by a third."""
    B = -np.array([[1.0, -2.0], [2.0, 1.0]]) / 5**0.5
    zero = np.zeros((2, 2))
    one = np.eye(2)
    low = B @ np.ones(2)
    return system(
        zero,
        np.hstack([-B, zero]),
        np.vstack([one, zero]),
        np.block([[zero, one], [-one, zero]]),
        [1.0, 0.3],
        3.0,
        u=lambda xp: lambda t: xp.asarray(low),
        q=lambda xp: lambda t: xp.array([0.0, 0.0, 2.0, 2.0]),
    )


@pytest.mark.survives("zeno")
def test_switches_that_accumulate_end_with_their_time():
    traj = solve(spiral(), "event_driven")
    times = np.unique([e.t for e in traj.events])
    limit = times[-1] + (times[-1] - times[-2]) / 2  # each turn takes a third of the one before
    assert traj.status.code == "chatter" and f"{limit:.6f}" in str(traj.status)
    rest = solve(spiral(), "theta", h=0.01)
    assert rest.status.ok and np.abs(rest.x[rest.t > limit + 0.05]).max() < 1e-12


def test_inputs_that_end_or_jump():
    root = system(
        NONE, ONE, ONE, NONE, [1.0], 2.0, u=lambda xp: lambda t: xp.sqrt(1.0 - t) * xp.ones(1)
    )
    with np.errstate(invalid="ignore"):
        for spec in ("event_driven", "theta"):
            traj = solve(root, spec)
            assert traj.status.code == "nan" and "t = 1" in str(traj.status)
    jump = system(
        NONE,
        ONE,
        ONE,
        NONE,
        [0.5],
        2.0,
        u=lambda xp: lambda t: xp.where(t < 0.7, -1.0, 1.0) * xp.ones(1),
    )
    traj = solve(jump, "event_driven")
    assert traj.status.ok and traj.x[-1, 0] == pytest.approx(1.3, abs=1e-12)
    assert [(e.kind, round(e.t, 9)) for e in traj.events] == [("contact", 0.5), ("release", 0.7)]


def test_a_pole_of_an_input_is_told_and_not_crept_up_to_for_ever():
    pole = system(NONE, ONE, ONE, ONE, [1.0], 2.0, u=lambda xp: lambda t: xp.ones(1) / (t - 0.7317))
    traj = solve(pole, "event_driven")
    assert (
        traj.status.code == "maxiter"
        and "t = 0.7316999" in str(traj.status)
        and traj.stats["steps"] < 2000
    )
    assert np.all(np.isnan(traj.x[traj.t > 0.74]))


def test_many_rows_are_chosen_by_short_steps():
    """Twelve independent diodes: more than all sets are tried for."""
    m = 12
    shift = np.linspace(0.1, 1.3, m)
    case = system(
        np.zeros((m, m)),
        np.eye(m),
        np.eye(m),
        np.zeros((m, m)),
        shift,
        3.0,
        u=lambda xp: lambda t: -xp.cos(t) * xp.ones(m),
    )
    traj = solve(case, "event_driven")
    down = shift < 1.0
    assert traj.status.ok and len(traj.events) == 2 * down.sum()
    want = np.where(down, 1.0, shift) - np.sin(3.0)
    np.testing.assert_allclose(traj.x[-1], want, atol=1e-13)
