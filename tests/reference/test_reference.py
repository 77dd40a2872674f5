"""A stored reference is what was computed, knows its own error, and is refused when damaged or of
another version."""

import dataclasses
import json

import numpy as np
import pytest
from chua import chua

import nsbench
from nsbench import Case, Complementarity, Filippov, get_case, load_case, reference
from nsbench.reference.storage import source_hash, stem
from nsbench.solvers import Status, Trajectory

TIDE = get_case("tide")
PAIR = (("event_driven", 1e-12), ("event_driven[method=rk45]", 1e-10))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """tide and slide_exit without their closed forms, built once."""
    folder = tmp_path_factory.mktemp("references")
    cases = [
        c.replace(exact=None, exact_impulse=None, exact_events=None)
        for c in (TIDE, get_case("slide_exit"))
    ]
    return folder, cases, [reference.build(c, folder, PAIR, kind="runs") for c in cases]


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["tide", "wedge[psi=120]", "two_discs[w=1]", "play", "chain", "dragged_disc"]
)
def test_the_reaction_of_a_closed_form_is_its_impulse_times_gradients(name):
    case = get_case(name)
    ref = reference.closed_form(case)
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.measure.context import near_of

    scene = ConstraintSet(case.problem, case.n)
    near = near_of(scene, ref.contacts)
    fine = np.linspace(*case.t[[0, -1]], 4001)
    mid = (fine[1:] + fine[:-1]) / 2
    step = np.diff(case.exact_impulse(fine), axis=0)
    force = np.zeros(case.n)
    for t, x, d in zip(mid, case.exact(mid), step, strict=True):
        if d.any():
            force += scene.gradients(t, x, near).T @ d
    assert np.abs(ref.reaction[-1] - force).max() < 1e-5 and ref.reaction_error < 1e-12
    assert np.all(ref.reaction[0] == 0.0)


@pytest.mark.long
def test_a_built_reference_is_right_within_its_own_bound(made):
    folder, cases, (tide, slide) = made
    assert np.abs(tide.x - TIDE.exact(TIDE.t)).max() <= tide.state_error < 1e-9
    assert np.abs(tide.impulse - TIDE.exact_impulse(TIDE.t)).max() <= tide.impulse_error < 1e-9
    assert (
        np.abs(slide.x[-1] - [2.402773187027679, -0.335717922687778]).max()
        <= slide.state_error
        < 1e-8
    )
    assert [e.kind for e in slide.events] == ["enter", "exit"] and slide.reaction is None
    for case, ref in zip(cases, (tide, slide), strict=True):
        a, b = (nsbench.solve(case, spec, tol=tol) for spec, tol in PAIR)
        assert ref.state_error == pytest.approx(2 * np.abs(a.x - b.x).max())
        assert ref.impulse_error == pytest.approx(2 * np.abs(a.impulse - b.impulse).max())
        back = reference.reference(case, folder)
        assert np.array_equal(back.x, ref.x) and np.array_equal(back.impulse, ref.impulse)
        assert back.events == ref.events and back.contacts == ref.contacts and back.kind == "stored"
        for key in ("state_error", "impulse_error", "reaction_error"):
            assert getattr(back, key) == getattr(ref, key) or np.isnan(getattr(ref, key))
        assert (
            "against" in back.how
            and back.versions["numpy"] == np.__version__
            and "comes from" in back.how
        )
        assert "confirmed" in reference.verify(case, folder)


def test_storing_again_gives_the_same_bytes(made, tmp_path):
    folder, (case, _), (ref, _) = made
    reference.store(case, ref, tmp_path)
    for a, b in zip(
        reference.files_of(case, folder), reference.files_of(case, tmp_path), strict=True
    ):
        assert a.read_bytes() == b.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tide.json", "tide.npz"]


def copies(made, tmp_path):
    folder, (case, _), _ = made
    for p in reference.files_of(case, folder):
        (tmp_path / p.name).write_bytes(p.read_bytes())
    return case, *reference.files_of(case, tmp_path)


def truncate(npz, js):
    npz.write_bytes(npz.read_bytes()[:200])


def other_arrays(npz, js):
    with np.load(npz) as z:
        np.savez_compressed(npz, **{**z, "x": z["x"] + 1e-12})


def better_bound(npz, js):
    meta = json.loads(js.read_text())
    js.write_text(json.dumps({**meta, "state_error": 1e-16}))


def half_json(npz, js):
    js.write_text(js.read_text()[:50])


def pickle_inside(npz, js):
    with np.load(npz) as z:
        np.savez(npz, **{**z, "x": np.array([{}], object)})


def no_json(npz, js):
    js.unlink()


def empty(npz, js):
    npz.write_bytes(b"")


@pytest.mark.survives("spoilt reference", "foreign reference")
@pytest.mark.parametrize(
    "damage", [truncate, other_arrays, better_bound, half_json, pickle_inside, no_json, empty]
)
def test_a_damaged_reference_is_refused_by_name(made, tmp_path, damage):
    case, npz, js = copies(made, tmp_path)
    damage(npz, js)
    with pytest.raises(reference.BadReference, match=r"tide\.npz"):
        reference.reference(case, tmp_path)
    known = case.replace(
        exact=TIDE.exact, exact_impulse=TIDE.exact_impulse, exact_events=TIDE.exact_events
    )
    with pytest.raises(
        reference.BadReference, match=r"tide\.npz"
    ):  # though its closed form has the impulses too
        reference.reference(known, tmp_path)


@pytest.mark.parametrize(
    "change, word",
    [
        ({"x0": np.array([0.5 + 1e-9])}, "x0"),
        ({"t": np.linspace(0, 3, 31)}, "t"),
        ({"t": np.linspace(0, 2.9, 61)}, "t"),
        ({"source": __file__}, "source"),
        (
            {
                "problem": Filippov(
                    {(1,): TIDE.problem.drift, (-1,): TIDE.problem.drift}, lambda xp: lambda t, x: x
                )
            },
            "problem",
        ),
    ],
)
@pytest.mark.survives("foreign reference")
def test_a_reference_of_another_version_of_the_case_is_refused(made, tmp_path, change, word):
    case, *_ = copies(made, tmp_path)
    with pytest.raises(reference.BadReference, match=f"another version of tide .*{word}"):
        reference.reference(case.replace(**change), tmp_path)
    assert reference.reference(case.replace(x0=case.x0 + 1e-16), tmp_path) is not None


FILE = '''"""A case."""
import numpy as np
from nsbench import Affine, Case, Complementarity

def drift(xp):
    """The wind."""
    def f(t, y):
        return -xp.cos(t) * xp.ones_like(y)
    return f

def make(height=0.5):
    floor = Affine(np.eye(1), np.zeros(1))
    return Case("mine", Complementarity(drift, (floor,)), np.array([height]), np.linspace(0, 3, 31))
'''


def test_the_text_of_the_case_counts_but_not_its_prose(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    case = load_case(path)
    reference.build(case, tmp_path / "r", PAIR, kind="runs")
    text = FILE.replace("A case.", "The same\n\nin more words.").replace("The wind", "Wind")
    path.write_text(text.replace("return f\n", "return f    # why\n\n"))
    assert reference.reference(load_case(path), tmp_path / "r").kind == "stored"
    path.write_text(FILE.replace("xp.cos(t)", "1.01 * xp.cos(t)"))
    with pytest.raises(reference.BadReference, match="source"):
        reference.reference(load_case(path), tmp_path / "r")
    assert source_hash(str(path)) not in ("", source_hash(TIDE.source))
    path.write_text(FILE)
    assert (
        reference.reference(load_case(path, height=0.6), tmp_path / "r") is None
    )  # other parameters, other files


def test_names_are_safe_for_files():
    assert stem(get_case("discs", n=30, seed=0)) == "discs_n30_seed0"
    odd = TIDE.replace(params={"a": "../../x", "b": -1e-3, "c": True})
    assert "/" not in stem(odd) and stem(odd) == "tide_a..-..-x_b-0.001_ctrue"
    npz, js = reference.files_of(odd, "/somewhere")
    assert npz.parent == js.parent and npz.suffix == ".npz" and js.suffix == ".json"


class Liar:
    """Event-driven runs with something wrong."""

    def __init__(self, monkeypatch, change):
        from nsbench import solvers

        honest = solvers.solve

        def solve(case, spec, **accuracy):
            run = honest(case, spec, **accuracy)
            return change(run) if "rk45" in spec else run

        monkeypatch.setattr("nsbench.solvers.solve", solve)


@pytest.mark.parametrize(
    "change, text",
    [
        (
            lambda r: Trajectory(r.t, r.x + 1e-6, r.contacts, r.impulse, r.reaction),
            "differ by 1.00e-06",
        ),
        (
            lambda r: Trajectory(r.t, r.x, r.contacts, r.impulse, r.reaction * 1.001),
            "in the reaction",
        ),
        (
            lambda r: Trajectory(
                r.t, r.x, r.contacts, r.impulse, r.reaction, Status("maxiter", "Too many.")
            ),
            "maxiter",
        ),
        (lambda r: Trajectory(r.t, r.x * np.nan, r.contacts, r.impulse, r.reaction), "not finite"),
    ],
)
def test_nothing_is_stored_when_the_methods_disagree_or_fail(monkeypatch, tmp_path, change, text):
    Liar(monkeypatch, change)
    with pytest.raises(ValueError, match=text):
        reference.build(TIDE, tmp_path, PAIR, kind="runs")
    assert not list(tmp_path.iterdir())


def test_nothing_is_stored_when_both_agree_on_something_else(monkeypatch, tmp_path):
    """Both event-driven runs see a floor that is not there: the witness of another kind notices."""
    higher = TIDE.replace(
        problem=Complementarity(TIDE.problem.drift, (nsbench.Affine(np.eye(1), -0.2 * np.ones(1)),))
    )
    from nsbench import solvers

    honest = solvers.solve
    monkeypatch.setattr(
        "nsbench.solvers.solve", lambda c, s, **a: honest(higher if "event" in s else c, s, **a)
    )
    with pytest.raises(ValueError, match="does not come closer"):
        reference.build(TIDE, tmp_path, PAIR, kind="runs")
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_flow_that_amplifies_errors_has_a_reference_with_the_bound_it_allows(tmp_path):
    """Of Chua's circuit to t = 45 both runs have the same events and differ by more than 1e-8; the
    witness of first order is lost by then, and is told to which time it confirms."""
    case = chua(45.0)
    ref = reference.build(case, tmp_path, kind="runs")
    assert "same events: the flow amplifies errors; euler" in ref.how and "up to t = " in ref.how
    finer = nsbench.solve(case, "event_driven", tol=1e-14)
    assert 1e-8 < ref.state_error < 1e-4 and np.abs(finer.x - ref.x).max() < ref.state_error


def test_a_witness_that_agrees_with_itself_has_another_solution(monkeypatch, tmp_path):
    """Both event-driven runs jump half-way: what comes before is confirmed, and nothing
    is amplified."""
    from nsbench import solvers

    honest = solvers.solve

    def wrong_late(case, spec, **accuracy):
        run = honest(case, spec, **accuracy)
        if "event" in spec:
            run = dataclasses.replace(run, x=run.x - 0.5 * (run.t > 1.5)[:, None])
        return run

    monkeypatch.setattr("nsbench.solvers.solve", wrong_late)
    with pytest.raises(ValueError, match="does not come closer"):
        reference.build(TIDE, tmp_path, PAIR, kind="runs")


@pytest.mark.long
def test_a_reference_is_confirmed_by_a_run_that_is_as_good_as_its_bound():
    """The first one, at 1e-12, is 5.8e-11 off, twice the bound."""
    said = reference.verify(get_case("buckling_row", n=6))
    assert said.startswith("confirmed by event_driven[method=rk45]")


def test_verify_notices_a_reference_that_is_wrong(made, tmp_path):
    case, _, _ = copies(made, tmp_path)
    good = reference.load(case, tmp_path)
    bad = dataclasses.replace(good, x=good.x + 1e-6)
    reference.store(case, bad, tmp_path)
    with pytest.raises(ValueError, match="the stored state"):
        reference.verify(case, tmp_path)
    with pytest.raises(ValueError, match="no stored reference"):
        reference.verify(case, tmp_path / "none")


def test_a_solution_that_is_not_unique_has_no_reference(tmp_path):
    case = TIDE.replace(unique=False)
    assert reference.reference(case) is None
    with pytest.raises(ValueError, match="no unique solution"):
        reference.build(case, tmp_path)


def test_a_closed_form_without_impulses_takes_them_from_the_stored_reference(made):
    folder, _, (ref, _) = made
    half = TIDE.replace(exact_impulse=None)
    found = reference.reference(half, folder)
    assert found.kind == "closed form" and np.array_equal(found.impulse, ref.impulse)
    assert found.state_error < 1e-14 and found.impulse_error == ref.impulse_error


def test_a_closed_form_of_the_wrong_shape_is_an_error():
    with pytest.raises(ValueError, match="exact of tide"):
        reference.reference(TIDE.replace(exact=lambda t: np.zeros(len(t))))
    with pytest.raises(ValueError, match="exact_impulse of tide"):
        reference.reference(TIDE.replace(exact_impulse=lambda t: np.full((len(t), 1), np.nan)))
    assert isinstance(TIDE, Case)


def test_floors_are_ten_times_the_references_error(made, monkeypatch):
    folder, (case, _), (ref, _) = made
    monkeypatch.setattr("nsbench.reference.storage.home", lambda: folder)
    e = nsbench.errors(case, nsbench.solve(case, "event_driven", tol=1e-12))
    assert e["reference"] == "stored" and e["state_floor"] == 10 * ref.state_error
    assert e["impulse_floor"] == 10 * ref.impulse_error and e["state_sup"] <= e["state_floor"]


@pytest.mark.parametrize("key", ["stiff_contact", "stiff_contact[K=10000]"])
def test_the_reaction_of_a_stiff_closed_form_is_within_its_bound(key):
    """One wall of slope 1: the reaction is the impulse. A layer of width 1/K follows the
    release."""
    case = get_case(key)
    ref = reference.closed_form(case)
    off = np.abs(ref.reaction - case.exact_impulse(case.t)).max()
    assert off <= ref.reaction_error < 1e-8 * case.exact_impulse(case.t).max()


def test_a_witness_whose_errors_scatter_goes_on_to_finer_steps(monkeypatch, tmp_path):
    """As explicit Euler at a sliding surface: two steps that give errors of one size say little."""
    from nsbench import solvers

    honest = solvers.solve

    def scattered(case, spec, **accuracy):
        run = honest(case, spec, **accuracy)
        if spec == "pbd" and accuracy["h"] > 5e-5:
            run = dataclasses.replace(run, x=run.x + 9e-3)
        return run

    monkeypatch.setattr("nsbench.solvers.solve", scattered)
    ref = reference.build(TIDE, tmp_path, PAIR, kind="runs")
    assert "pbd comes from" in ref.how and "e-05 to" in ref.how


def test_a_reference_without_certificate_says_what_its_bound_is_and_what_would_prove_it(
    tmp_path, monkeypatch
):
    monkeypatch.setattr("nsbench.reference.certify.certificate.available", lambda: False)
    how = reference.build(get_case("tide"), tmp_path).how
    assert "two integrators that agree, it is not proven" in how
    assert "pip install python-flint" in how
