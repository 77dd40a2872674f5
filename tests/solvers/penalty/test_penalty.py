"""The penalty method solves the penalised problem to its tolerance, is of order one in 1/k, and
says when it cannot."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Filippov, get_case, solve
from nsbench.compilation import jax_cache
from nsbench.solvers import get

TIDE = get_case("tide")


def penalised_tide(t, k):
    """y' = -cos t - k min(y, 0): falls until t1, y = particular + C e^(-k (t - t1)) below 0, then 1
    - sin t shifted."""
    # e^(-k pi/3) < 1e-13 is left out
    t1 = np.pi / 6
    t2 = np.pi / 2 + np.arctan(1 / k)
    y = lambda t: -(k * np.cos(t) + np.sin(t)) / (1 + k * k)
    below = y(t) - y(t1) * np.exp(-k * np.clip(t - t1, 0.0, 700.0 / k))
    return np.where(t < t1, 0.5 - np.sin(t), np.where(t < t2, below, np.sin(t2) - np.sin(t)))


def test_order_one_in_state_and_impulse():
    ks = np.geomspace(*get("penalty").ladder, 9)
    state = []
    impulse = []
    for k in ks:
        traj = solve(TIDE, "penalty", k=k)
        assert traj.status.ok and traj.stats["h"] == 1 / k
        assert np.abs(traj.x[:, 0] - penalised_tide(traj.t, k)).max() < 1e-7
        state.append(np.abs(traj.x - TIDE.exact(traj.t)).max())
        impulse.append(np.abs(traj.impulse - TIDE.exact_impulse(traj.t)).max())
    for err in (state, impulse):
        assert abs(np.polyfit(np.log(1 / ks), np.log(err), 1)[0] - 1.0) < 0.03
    assert (
        abs(state[-1] * ks[-1] - np.cos(np.pi / 6)) < 0.03
    )  # y - y_k -> cos(t1) / k just after the impact


@pytest.mark.long
@pytest.mark.parametrize(
    "method, case",
    [
        ("dopri8", "tide"),
        ("kvaerno3", "dragged_disc"),
        ("kvaerno5", "slide_exit"),
        ("kvaerno5", "three_discs"),
        ("bosh3", "slide_exit"),
    ],
)
def test_explicit_and_implicit_agree(method, case):
    a = solve(case, "penalty", k=1e3)
    b = solve(case, f"penalty[method={method}]", k=1e3)
    assert a.status.ok and b.status.ok and a.contacts == b.contacts
    for u, v in ((a.x, b.x), (a.impulse, b.impulse), (a.reaction, b.reaction)):
        assert u.size == 0 or np.abs(u - v).max() < 3e-7


def test_implicit_goes_on_where_explicit_meets_the_wall():
    for k in (1e6, 1e7):
        traj = solve(TIDE, "penalty[method=kvaerno3]", k=k)
        assert traj.status.ok and traj.stats["steps"] < 2000
        assert abs(np.abs(traj.x - TIDE.exact(traj.t)).max() * k - np.cos(np.pi / 6)) < 0.03
    wall = solve(TIDE, "penalty[max_steps=20000]", k=1e10)
    assert (
        wall.status.code == "maxiter"
        and "too stiff" in str(wall.status)
        and "kvaerno5" in str(wall.status)
    )
    known = np.isfinite(wall.x[:, 0])
    assert known[0] and not known[-1] and np.all(np.diff(known.astype(int)) <= 0)
    assert (
        np.isnan(wall.reaction[~known]).all()
        and wall.stats["steps"] + wall.stats["refused_steps"] == 20000
    )
    hidden = solve(TIDE, "penalty[method=kvaerno3]", k=1e9)
    assert hidden.status.code == "unverified" and "tolerance" in str(hidden.status)
    better = solve(TIDE, "penalty[method=kvaerno3,rtol=1e-12,atol=1e-12]", k=1e9)
    assert (
        better.status.ok
        and abs(np.abs(better.x - TIDE.exact(better.t)).max() * 1e9 - np.cos(np.pi / 6)) < 0.03
    )


@pytest.mark.long
def test_the_integrator_is_chosen_by_k():
    low, high = (solve("three_discs", "penalty[method=auto]", k=k) for k in (1e3, 1e5))
    assert low.stats["integrator"] == "tsit5" and high.stats["integrator"] == "kvaerno5"
    assert (
        np.array_equal(low.x, solve("three_discs", "penalty", k=1e3).x)
        and high.stats["steps"] < 1000
    )
    assert (
        solve("three_discs", "penalty[method=auto,extrapolate=1]", k=1500.0).stats["integrator"]
        == "kvaerno5"
    )


@pytest.mark.long
def test_newton_does_not_take_rounding_for_divergence():
    traj = solve("hex", "penalty[method=kvaerno5]", k=1631.0626448979872)
    assert traj.status.ok and traj.stats["steps"] + traj.stats["refused_steps"] < 300


def test_float64_whoever_imported_jax_before():
    import jax

    before = solve(TIDE, "penalty", k=1e3)
    jax.config.update("jax_enable_x64", False)
    cached = solve(TIDE, "penalty", k=1e3)
    jax.config.update("jax_enable_x64", False)
    fresh = solve(
        TIDE.replace(problem=Complementarity(TIDE.problem.drift, TIDE.problem.constraints)),
        "penalty",
        k=1e3,
    )
    for traj in (cached, fresh):
        assert traj.x.dtype == np.float64 and np.array_equal(traj.x, before.x)


@pytest.mark.parametrize("up, weight", [(1.0, 1 / 2), (2.0, 2 / 3)])
def test_sliding_has_its_weight_in_the_mean(up, weight):
    """f+ = (1, -1), f- = (2, up): weight 1 until x2 = 0 at t = 1/2, then up / (1 + up)."""
    case = Case(
        "slide",
        Filippov(
            {
                (1,): lambda xp: lambda t, x: xp.stack([1.0 + 0 * t, -1.0 + 0 * t]),
                (-1,): lambda xp: lambda t, x: xp.stack([2.0 + 0 * t, up + 0 * t]),
            },
            lambda xp: lambda t, x: x[1:],
        ),
        np.array([0.0, 0.5]),
        np.linspace(0.0, 2.0, 9),
    )
    traj = solve(case, "penalty", k=1e4)
    assert traj.contacts == ((0, 0),) and traj.reaction.shape == (9, 0)
    assert np.allclose(np.diff(traj.impulse[:, 0]) / 0.25, [1, 1] + 6 * [weight], atol=1e-3)
    assert np.allclose(np.diff(traj.impulse[3:, 0]) / 0.25, weight, atol=1e-7)
    assert np.allclose(np.diff(traj.x[3:], axis=0) / 0.25, [2.0 - weight, 0.0], atol=1e-7)


def test_one_compilation_serves_every_k_start_and_tolerance(monkeypatch):
    monkeypatch.setattr(
        jax_cache, "folder", lambda: None
    )  # what an earlier run left on disk is not asked
    traced = []

    def drift(xp):
        def f(t, x):
            if xp.__name__ != "numpy":
                traced.append(1)
            return -xp.cos(t) * xp.ones_like(x)

        return f

    case = TIDE.replace(problem=Complementarity(drift, TIDE.problem.constraints))
    method = get("penalty")
    method.prepare(case, 10.0)
    first = len(traced)
    runs = [method.prepare(case, k)() for k in (30.0, 100.0, 300.0)]
    moved = get("penalty[rtol=1e-6,max_steps=500]").prepare(
        case.replace(x0=np.array([0.6]), t=case.t / 2), 50.0
    )()
    assert first > 0 and len(traced) == first
    assert (
        all(r.status.ok for r in runs)
        and moved.status.ok
        and moved.x[0, 0] == 0.6
        and moved.t[-1] == 1.5
    )
    assert np.array_equal(runs[1].x, solve(TIDE, "penalty", k=100.0).x)


def growing(xp):
    return lambda t, x: x * x


def undefined_later(xp):
    return lambda t, x: xp.sqrt(1.0 - t) * xp.ones_like(x) - 2.0


def branching(xp):
    return lambda t, x: x if x[0] > 0 else -x


@pytest.mark.long
@pytest.mark.parametrize(
    "drift, code, word",
    [
        (growing, "diverged", "bounds"),
        (undefined_later, "nan", "t = 1 of 2"),
        (branching, "refused", "JAX"),
    ],
)
@pytest.mark.parametrize("method", ["tsit5", "kvaerno5"])
def test_failures_are_values_with_a_sentence(drift, code, word, method):
    case = Case(
        "fails",
        Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),)),
        np.ones(1),
        np.linspace(0, 2, 11),
    )
    with np.errstate(all="ignore"):
        traj = solve(case, f"penalty[method={method}]")
    assert traj.status.code == code and word in str(traj.status) and str(traj.status).endswith(".")
    if code != "refused":
        assert np.isnan(traj.x[-1]).all() and np.isfinite(traj.x[0]).all()


def test_what_is_refused():
    many = Case(
        "many",
        Complementarity(
            lambda xp: lambda t, x: -x, (Distance(2.0, anchors=np.full((100, 2), 1e4)),)
        ),
        5.0 * np.arange(398.0),
        np.linspace(0, 1, 3),
    )
    assert (
        "19900" in solve(many, "penalty").status.why and "MB" in solve(many, "penalty").status.why
    )
    empty = TIDE.replace(problem=Complementarity(TIDE.problem.drift, ()))
    assert solve(empty, "penalty").status.code == "refused"
    one = np.ones((1, 1))
    lcs = Case("lcs", nsbench.LCS(-one, one, one, one), np.ones(1), np.linspace(0, 1, 3))
    assert solve(lcs, "penalty").status.code == "refused"
    for option, text in (
        ("method=euler", "euler"),
        ("rtol=0", "rtol"),
        ("extrapolate=3", "extrapolate"),
        ("pairs=some", "pairs"),
        ("reach=0", "reach"),
        ("atol=-1", "atol"),
        ("max_steps=0", "max_steps"),
    ):
        with pytest.raises(ValueError, match=text):
            get(f"penalty[{option}]")
    with pytest.raises(ValueError, match="k is"):
        solve(TIDE, "penalty", k=float("nan"))
