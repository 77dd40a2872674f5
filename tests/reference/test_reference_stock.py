"""What is stored belongs to the cases as they are, is bounded, and agrees with every closed
form."""

import json
from decimal import Decimal

import numpy as np
import pytest

from nsbench import get_case, reference
from nsbench.reference.storage import home

KEYS = sorted(json.loads(p.read_text())["fingerprint"]["case"] for p in home().glob("*.json"))
SMALL = (
    "three_discs",
    "chain",
    "epithelium[n=3]",
    "slide_exit",
    "stick_slip",
    "tide",
    "obstacle",
    "bean",
    "box_turning",
    "circle_sliding",
    "play",
    "dragged_disc",
    "discs[n=3,seed=0]",
)


@pytest.mark.parametrize("key", KEYS)
def test_a_stored_reference_fits_its_case(key):
    case = get_case(key)
    stored = reference.load(case)
    used = reference.reference(case)
    scale = max(1.0, np.abs(stored.x).max())
    assert 0.0 < stored.state_error <= 1e-8 * scale and "against" in stored.how + "against" * (
        stored.kind == "certified"
    )
    assert np.abs(stored.x[0] - case.x0).max() < 1e-9 or case.start == "project"
    if case.exact is not None:
        assert used.kind == "closed form" and used.state_error < 1e-12 * scale
    if stored.kind == "certified":
        assert stored.state_error < 1e-14 * scale and stored.versions["python-flint"]
        times = np.unique([e.t for e in stored.events])
        known = [float(s) for s in stored.shown["times"]]
        assert np.array_equal(times, np.unique(known))
        assert np.allclose(
            stored.x[-1], [float(s) for s in stored.shown["final"]], rtol=0, atol=1e-15 * scale
        )


@pytest.mark.parametrize("key", SMALL)
def test_small_scenes_are_certified(key):
    assert reference.load(get_case(key)).kind == "certified"


def test_slide_exit_carries_the_digits_that_were_computed_otherwise():
    """40 digits by other means (Taylor series of the free arcs, quadrature of dx1/v(x1) along the
    line)."""
    ref = reference.load(get_case("slide_exit"))
    known = (
        "0.53625460434312500",
        "0.98470044921025719",
        "2.4027731870276790",
        "-0.33571792268777756",
    )
    for mine, other in zip((*ref.shown["times"], *ref.shown["final"]), known, strict=True):
        assert abs(Decimal(mine) - Decimal(other)) <= Decimal(10) ** -(len(other.split(".")[1]))


def test_the_digits_of_three_discs_are_those_of_the_free_motion():
    """The first contact from the closed form of free motion: |d0| e^-t = 2; the mean is m0 e^-t for
    ever."""
    flint = pytest.importorskip("flint", reason="more digits than a float needs python-flint")
    case = get_case("three_discs")
    old = flint.ctx.prec
    flint.ctx.prec = 160
    x = [flint.arb(float(v)) for v in case.x0]
    t = (((x[0] - x[2]) ** 2 + (x[1] - x[3]) ** 2).sqrt() / 2).log()
    text = t.str(30, radius=False)
    flint.ctx.prec = old
    ref = reference.load(case)
    assert ref.shown["times"][0][:29] == text[:29]
    mean = ref.x.reshape(len(case.t), 3, 2).mean(axis=1)
    assert np.abs(mean - mean[0] * np.exp(-case.t)[:, None]).max() < 1e-15


def test_a_case_of_somebody_else_may_bear_a_stored_name(tmp_path):
    """three_discs in a user's file is another case: it has no reference, and running it is no
    error."""
    import nsbench

    path = tmp_path / "three_discs.py"
    path.write_text(
        "import numpy as np\nfrom nsbench import Case, Complementarity\n"
        "CASE = Case('three_discs', Complementarity(lambda xp: lambda t, x: -x), np.ones(1), "
        "np.linspace(0, 1, 3))\n"
    )
    case = nsbench.load_case(path)
    assert reference.reference(case) is None
    assert nsbench.errors(case, nsbench.solve(case, "event_driven"))["reference"] == "none"
    with pytest.raises(reference.BadReference, match="another version"):
        reference.reference(get_case("three_discs").replace(x0=get_case("three_discs").x0 + 1e-9))
