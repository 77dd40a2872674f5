"""Plateaus: true solutions of any scene, verdicts that survive h/4, a search that finds the worst."""

import numpy as np
import pytest

import nsbench
from nsbench.measure.context import make_context
from nsbench.reference import reference
from nsbench.studies.finding import Effort
from nsbench.studies.part_journal import PartJournal
from nsbench.studies.plateau import adversary, study
from nsbench.studies.plateau.scenes import FULL, Scene, find_scene, make_corner
from nsbench.studies.runs import ladders
from nsbench.studies.runs.truth import extrapolate, find_truth, follow_events


@pytest.mark.parametrize("psi", [1.0, 60.0, 179.0])
def test_the_closed_form_of_the_corner_agrees_with_the_event_driven_method(psi):
    case = make_corner(psi)
    found = follow_events(case)
    scale = np.abs(case.exact_impulse(case.t)).max()
    assert np.abs(found.x - case.exact(case.t)).max() < 1e-9
    assert np.abs(found.impulse - case.exact_impulse(case.t)).max() < 1e-9 * max(1.0, scale)


@pytest.mark.parametrize("psi", [1.0, 45.0, 90.0, 179.0])
def test_the_search_reaches_corners_of_every_angle(psi):
    for lean in adversary.FAMILIES["corner"]["lean"][:2]:
        case = make_corner(psi, lean=lean)
        pressed = case.exact_impulse(case.t[-2:])
        assert (np.diff(pressed, axis=0) > 0.0).all()


def test_a_corner_whose_force_misses_a_wall_is_no_scene():
    with pytest.raises(ValueError, match="both walls"):
        make_corner(30.0, lean=1.5)


def test_every_scene_of_the_study_exists():
    for scene in FULL:
        assert find_scene(scene.key).n > 0


def test_computed_solutions_agree_with_the_stored_one_within_their_bounds():
    case = nsbench.get_case("three_discs")
    known = reference(case)
    for found in (follow_events(case), extrapolate(case, 16)):
        assert np.abs(found.x - known.x).max() <= found.state_error + known.state_error
        assert np.abs(found.reaction - known.reaction).max() <= found.reaction_error
    assert find_truth(case).kind == known.kind


def test_errors_against_a_computed_solution_are_those_against_the_stored_one():
    case = nsbench.get_case("three_discs")
    traj = nsbench.solve(case, "pbd", h=0.01)
    own = nsbench.errors(case, traj)
    other = nsbench.errors(case, traj, make_context(case, follow_events(case)))
    for name in ("state_sup", "impulse", "reaction"):
        assert other[name] == pytest.approx(own[name], rel=1e-6)


def test_a_case_without_reference_has_errors_against_a_computed_solution():
    case = make_corner(60.0).replace(exact=None, exact_impulse=None)
    traj = nsbench.solve(case, "pbd", h=0.01)
    found = nsbench.errors(case, traj, ladders.context_of_truth(case))
    true = np.abs(traj.x - make_corner(60.0).exact(case.t)).max()
    assert found["state_sup"] == pytest.approx(true, rel=1e-6)
    assert np.isnan(nsbench.errors(case, traj)["state_sup"])


def synthetic(level):
    """Ladder rows of an error level + h, in place of runs."""

    def climb(case, method, substeps, context):
        spacing = float(np.diff(case.t).min())
        out = []
        for n in substeps:
            h = spacing / n
            row = {"substeps": n, "h": h, "status": "ok", "why": ""}
            for name in ladders.QUANTITIES:
                row[name] = level(h) + h
                row[f"{name}_floor"] = 1e-14
                row[f"{name}_scale"] = 1.0
            out.append(row)
        return out

    return climb


def test_an_error_that_levels_off_stalls_and_one_that_goes_on_falling_does_not(monkeypatch):
    case = nsbench.get_case("tide")
    monkeypatch.setattr(ladders, "climb", synthetic(lambda h: 1e-2))
    found = ladders.convergence(case, "pbd", 4, 6)
    assert {v["verdict"] for v in found["verdicts"].values()} == {ladders.STALLS}
    finest = found["rows"][-1]["h"]
    assert finest <= 0.05 / (4 * 2**6 * 4) * 1.01  # it was asked again at a quarter of the step
    monkeypatch.setattr(ladders, "climb", synthetic(lambda h: 1e-2 if h > 2.1e-4 else 0.0))
    found = ladders.convergence(case, "pbd", 4, 6)
    assert ladders.STALLS not in {v["verdict"] for v in found["verdicts"].values()}


def test_pbd_has_order_one_in_a_corner_in_all_three_errors():
    found = ladders.convergence(make_corner(60.0), "pbd", 8, 6)
    for verdict in found["verdicts"].values():
        assert verdict["verdict"] == "order" and verdict["order"] == pytest.approx(1.0, abs=0.02)


def test_the_search_keeps_what_makes_the_ratio_larger(monkeypatch):
    """The ratio of a made-up method grows with the angle: the search must end near 179 degrees."""
    monkeypatch.setattr(adversary, "FAMILIES", {"corner": {"psi": (90.0, 179.0, False)}})

    def error(case, truth, method, substeps):
        psi = case.params["psi"]
        return 1.0 if substeps[0] == adversary.COARSE[0] else psi / 180.0

    monkeypatch.setattr(adversary, "largest_error", error)
    found = adversary.search(3, 1, 30)
    best = found["best"][0]
    assert found["measured"] == 31
    assert best["ratio"] == max(found["ratios"]) == best["params"]["psi"] / 180.0
    assert best["ratio"] > max(0.85, found["ratios"][0])


def test_the_study_in_a_tiny_form(monkeypatch):
    monkeypatch.setattr(study, "SMALL", (Scene("acute wedges", "corner[psi=60.0]", 8),))
    monkeypatch.setattr(adversary, "FAMILIES", {"corner": {"psi": (20.0, 80.0, False)}})
    monkeypatch.setattr(study, "RESTARTS", (1, 1))
    monkeypatch.setattr(study, "MOVES", (1, 1))
    finding = study.conduct(Effort(False, PartJournal(None), lambda line: None))
    assert finding.answer.startswith("No plateau was found: of 2 ladders")
    assert "corner[psi=" in finding.answer and finding.figures[0].svg.startswith("<?xml")
    assert "mathdefault" not in finding.figures[0].svg
