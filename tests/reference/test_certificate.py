"""A certificate proves the solution, and refuses whatever is not: wrong arcs, dips between samples,
kinks it cannot see."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

flint = pytest.importorskip(
    "flint", reason="certificates need python-flint (pip install nsbench[certify])"
)

from nsbench import (  # noqa: E402
    Affine,
    Case,
    Complementarity,
    Distance,
    Filippov,
    Smooth,
    get_case,
    reference,
)
from nsbench.reference.certify.ball_algebra import (
    Refused,
    positive,
)
from nsbench.reference.certify import certificate  # noqa: E402
from nsbench.reference.certify.certificate import certify  # noqa: E402
from nsbench.reference.certify.claimed_arcs import arcs_of  # noqa: E402

TIDE = get_case("tide")


@pytest.fixture(scope="module")
def tide():
    return certify(TIDE), arcs_of(TIDE)


def test_the_tide_is_proven_to_thirty_digits(tide):
    """Its events are pi/6 and pi/2, its last state 1 - sin 3."""
    made, _ = tide
    assert [s[:30] for s in made.reference.shown["times"]] == [
        "0.5235987755982988730771072305",
        "1.5707963267948966192313216916",
    ]
    assert made.reference.shown["final"][0].startswith("0.858879991940132777899255197")
    assert max(made.proven.values()) < 1e-30 and not made.notes
    assert np.abs(made.reference.x - TIDE.exact(TIDE.t)).max() < 1e-15
    assert np.abs(made.reference.impulse - TIDE.exact_impulse(TIDE.t)).max() < 1e-15


def test_a_relay_is_proven_with_the_sums_of_its_matrix_exact():
    """x' = B s with both signs positive: -1 - 0.2 of the doubles is no double, and ten times what
    it is off would be seen in the last state."""
    B = np.array([[-1.0, -0.2], [0.3, -1.0]])
    still = lambda xp: lambda t, x: xp.zeros(2)
    problem = Filippov.relay(still, B, lambda xp: lambda t, x: x + 1.0)
    case = Case("falls", problem, np.array([12.25, 8.5]), np.linspace(0.0, 10.0, 6))
    found = certify(case).reference
    rates = [sum(Fraction(b) for b in row) for row in B]
    for t, x in zip(case.t, found.x, strict=True):
        exact = [Fraction(a) + Fraction(t) * v for a, v in zip(case.x0, rates, strict=True)]
        assert x.tolist() == [float(v) for v in exact]


def test_a_bound_holds_against_a_computation_with_more_digits():
    """slide_exit once more in 60 digits: the difference is within the bound, and the bound is no
    more than sharp."""
    from nsbench.reference.certify.error_bound import enclose
    from nsbench.reference.certify.high_precision_path import Digits, event_times, follow, precision

    case = get_case("slide_exit")
    arcs = arcs_of(case)
    coarse = Digits(24, 24.0, 140)
    fine = Digits(60, 60.0, 320)
    a, b = (follow(case, arcs, d, case.x0) for d in (coarse, fine))
    bounds = enclose(a, coarse)
    with precision(fine):
        off = max(
            abs(float(u - v))
            for p, q in zip(a.x, b.x, strict=True)
            for u, v in zip(p, q, strict=True)
        )
        late = max(abs(float(u - v)) for u, v in zip(event_times(a), event_times(b), strict=True))
    assert 1e-30 < off <= bounds.state < 1e-19 and 0.0 < late <= max(bounds.times) < 1e-19


def change(arcs, k, **fields):
    return [dataclasses.replace(a, **fields) if i == k else a for i, a in enumerate(arcs)]


def test_a_contact_that_is_said_never_to_release_is_refused(tide):
    arcs = tide[1]
    with pytest.raises(Refused, match=r"lam of \(0, 0\) does not stay positive.*: it is -"):
        certify(TIDE, [arcs[0], dataclasses.replace(arcs[1], end=3.0, triggers=())])


@pytest.mark.parametrize(
    "k, fields, text",
    [
        (0, {"end": 0.51}, "is said to vanish at t = 0.51; it does not"),
        (0, {"triggers": (("lam", (0, 0)),)}, "the arc before does not have it"),
        (0, {"triggers": ()}, "without anything that vanishes"),
        (1, {"held": ()}, "the arc before does not have it"),
        (0, {"held": ((0, 0),)}, r"is said to hold \(0, 0\), which is 5"),
        (1, {"end": 1.2}, "does not"),
    ],
    ids=["early", "other", "none", "falls through", "floats", "releases early"],
)
def test_wrong_arcs_are_refused(tide, k, fields, text):
    with pytest.raises(Refused, match=text):
        certify(TIDE, change(tide[1], k, **fields))


def test_a_missed_contact_is_refused():
    """three_discs without its last contact: the third pair is shown to overlap."""
    case = get_case("three_discs")
    arcs = arcs_of(case)
    with pytest.raises(Refused, match=r"gap of \(0, 0, 2\) does not stay positive.*: it is -"):
        certify(case, [*arcs[:2], dataclasses.replace(arcs[2], end=3.0, triggers=())])


def test_sliding_that_should_have_ended_is_refused():
    case = get_case("slide_exit")
    arcs = arcs_of(case)
    with pytest.raises(Refused, match=r"lower of \(0, 0\) does not stay positive"):
        certify(case, [arcs[0], dataclasses.replace(arcs[1], end=1.5, triggers=())])


def spike(depth, width=1e-3):
    """A floor with a spike of `width` at t = 0.5 that reaches 1 + depth; the point waits at height
    1."""

    def floor(xp):
        def b(t):
            return -(1.0 + depth) / (1.0 + ((t - 0.5) / width) ** 2) * xp.ones(1)

        return b

    still = lambda xp: lambda t, x: 0.0 * x
    return Case(
        "spike",
        Complementarity(still, (Affine(np.eye(1), floor),)),
        np.ones(1),
        np.array([0.0, 0.3, 0.8, 1.0]),
    )


def test_a_spike_between_samples_is_seen():
    """A run that misses it claims one free arc: refused. A spike that stays below is no obstacle to
    the proof."""
    from nsbench.reference.certify.claimed_arcs import Arc

    with pytest.raises(Refused, match=r"gap of \(0, 0\) does not stay positive.*: it is -"):
        certify(spike(1e-4), [Arc(1.0, ())])
    assert max(certify(spike(-1e-4), [Arc(1.0, ())]).proven.values()) < 1e-30


def test_a_dip_of_a_polynomial_is_found_by_balls():
    p = flint.arb_poly([1e-6 + 0.25, -1.0, 1.0])  # 1e-6 at 1/2, above 0.01 on any coarse grid
    assert positive(p, 0.0, 1.0, 0.0) is None
    s = positive(p - 2e-6, 0.0, 1.0, 0.0)
    assert s is not None and abs(s - 0.5) < 2e-3
    assert positive(p, 0.0, 1.0, 2e-6) is not None


def test_kinks_of_the_drift_end_steps():
    """x' = -max(x - 1, -t) + |t - 1|: solved by hand up to the first kink at x - 1 = -t, compared
    with fine steps after."""

    def drift(xp):
        def f(t, x):
            return -xp.maximum(x - 1.0, -t) + xp.abs(t - 1.0) * xp.ones_like(x)

        return f

    case = Case("kinks", Complementarity(drift), np.array([0.3]), np.linspace(0.0, 2.0, 5))
    made = certify(case)
    import nsbench

    run = nsbench.solve(case, "event_driven", tol=1e-13)
    assert (
        np.abs(run.x - made.reference.x).max() < 1e-9
        and made.proven["state"] < 1e-25
        and made.steps >= 3
    )


@pytest.mark.long
def test_every_family_and_the_namespace():
    """A smooth wall, a moving one, an anchored disc and complex arithmetic in the drift, against
    event_driven."""

    def drift(xp):
        def f(t, x):
            z = x[0] + 1j * x[1]
            w = -0.3 * z * xp.exp(0.2j * z) / (1.0 + xp.abs(z))
            return xp.stack([w.real + 0.4 * xp.cos(3.0 * t), w.imag - 1.0 + 0.0 * xp.tanh(x[1])])

        return f

    bowl = Smooth(lambda xp: lambda t, x: x[1:2] + 1.0 - 0.3 * xp.sin(x[0:1] + 0.2 * t))
    wall = Affine(np.array([[1.0, 0.0]]), lambda xp: lambda t: (0.9 + 0.1 * xp.sin(t)) * xp.ones(1))
    post = Distance(
        d=0.5, pairs=[[0, 0]], anchors=lambda xp: lambda t: xp.array([[1.2 + 0.1 * t, -0.8]])
    )
    case = Case(
        "mixed",
        Complementarity(drift, (bowl, wall, post)),
        np.array([0.2, 0.3]),
        np.linspace(0.0, 1.8, 4),
    )
    import nsbench

    run = nsbench.solve(case, "event_driven", tol=1e-13)
    made = certify(case)
    assert run.status.ok and len(run.events) >= 1 and made.proven["state"] < 1e-25
    assert np.abs(run.x - made.reference.x).max() < 1e-10
    assert [e.contact for e in made.reference.events] == [e.contact for e in run.events]


def test_what_the_namespace_does_not_know_is_said():
    case = Case(
        "odd",
        Complementarity(lambda xp: lambda t, x: -xp.cbrt(x)),
        np.ones(1),
        np.linspace(0, 1, 3),
    )
    with pytest.raises(NotImplementedError, match="no array function 'cbrt'"):
        certify(case)


def test_two_surfaces_slide_together():
    """x' = B s on both axes with a strong diagonal: rest in the corner, and drift along the third
    coordinate."""
    B = np.array([[-1.0, 0.2], [0.3, -1.0], [0.5, -0.25]])
    f = np.array([0.3, -0.2, 1.0])
    case = Case(
        "corner",
        Filippov.relay(
            lambda xp: lambda t, x: f * (1.0 + 0.1 * xp.sin(t)) + 0.0 * x,
            B,
            lambda xp: lambda t, x: x[0:2],
        ),
        np.array([0.0, 0.0, 0.0]),
        np.linspace(0.0, 1.0, 5),
    )
    made = certify(case)
    s = -np.linalg.solve(B[:2], f[:2])
    grown = 1.0 + 0.1 * (1.0 - np.cos(1.0))
    assert abs(made.reference.x[-1, 2] - (f[2] + B[2] @ s) * grown) < 1e-15
    assert np.abs(made.reference.impulse[-1] - 0.5 * (1.0 + s * grown)).max() < 1e-15


@pytest.mark.long
def test_building_prefers_the_proof_and_says_why_not(tmp_path):
    case = get_case("slide_exit")
    ref = reference.build(case, tmp_path)
    assert ref.kind == "certified" and ref.state_error < 1e-15 and "proven" in ref.how
    back = reference.load(case, tmp_path)
    assert (
        back.shown == ref.shown
        and back.kind == "certified"
        and back.event_error == ref.event_error < 1e-15
    )
    assert "confirmed" in reference.verify(case, tmp_path) and "proven again" in reference.verify(
        case, tmp_path, certify=True
    )
    odd = Case(
        "odd",
        Complementarity(lambda xp: lambda t, x: -xp.cbrt(x)),
        np.ones(1),
        np.linspace(0, 0.5, 3),
    )
    assert (
        "no certificate: certificates know no array function 'cbrt'"
        in reference.build(odd, tmp_path).how
    )
    with pytest.raises(ValueError, match="odd is not certified"):
        reference.build(odd, tmp_path, kind="certified")


def damaged(ref, name, size):
    """One entry cut off after the digit before `size`: 2.40277318(70...) becomes 2.4027731."""
    value = getattr(ref, name).copy()
    value[-1, 0] = np.trunc(value[-1, 0] / (10 * size)) * 10 * size
    return dataclasses.replace(ref, **{name: value})


@pytest.mark.long
@pytest.mark.parametrize("certify_again", [False, True])
def test_a_state_truncated_by_one_digit_in_1e8_is_noticed(tmp_path, certify_again):
    case = get_case("slide_exit")
    ref = reference.build(case, tmp_path)
    bad = damaged(ref, "x", 1e-8)
    assert 1e-9 < np.abs(bad.x - ref.x).max() < 1e-7
    reference.store(case, bad, tmp_path)
    with pytest.raises(ValueError, match="the stored state"):
        reference.verify(case, tmp_path, certify=certify_again)


def test_a_wrong_event_time_is_noticed(tmp_path):
    case = get_case("slide_exit")
    ref = reference.build(case, tmp_path)
    events = (dataclasses.replace(ref.events[0], t=ref.events[0].t + 1e-8), ref.events[1])
    reference.store(case, dataclasses.replace(ref, events=events), tmp_path)
    for certify_again in (False, True):
        with pytest.raises(ValueError, match="the stored event times"):
            reference.verify(case, tmp_path, certify=certify_again)


def test_a_certificate_bounds_the_closed_form(tmp_path):
    reference.build(TIDE, tmp_path)
    ref = reference.reference(TIDE, tmp_path)
    assert (
        ref.kind == "closed form"
        and "a certificate differs by" in ref.how
        and ref.state_error < 1e-15
    )
    wrong = TIDE.replace(exact=lambda t: TIDE.exact(t) + 1e-12)
    with pytest.raises(
        ValueError, match=r"closed form and its certificate differ by 1[.]00e-12 in exact[(]t[)]"
    ):
        reference.reference(wrong, tmp_path)
    wrong = TIDE.replace(exact_impulse=lambda t: TIDE.exact_impulse(t) * (1 + 1e-11))
    with pytest.raises(ValueError, match="in exact_impulse"):
        reference.verify(wrong, tmp_path)


def test_a_proof_that_costs_too_much_is_given_up_and_a_longer_one_is_made_when_asked_for(
    tmp_path, monkeypatch
):
    from nsbench.reference.certify.error_bound import enclose
    from nsbench.reference.certify.high_precision_path import Digits, follow

    case = get_case("tide")
    with pytest.raises(ValueError, match=r"more than 5e\+01 operations on series by t = 0"):
        certify(case, operations=50.0)
    path = follow(case, arcs_of(case), Digits(40, 36.0, 200), case.x0)
    with pytest.raises(ValueError, match=r"more than 4e\+01 operations on series by t = 0"):
        enclose(path, Digits(40, 36.0, 200, operations=10.0))
    monkeypatch.setattr(certificate, "OPERATIONS", 50.0)
    assert "operations on series" in reference.build(case, tmp_path).how
    assert reference.build(case, tmp_path, kind="certified").kind == "certified"
