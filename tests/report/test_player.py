"""Frames of players: what is stored is what the runs are, and what others stored is checked."""

import base64
import gzip
import json

import numpy as np
import pytest
from report_rows import made, row

import nsbench
from nsbench.cli import main
from nsbench.report.charts.payload import pack_player
from nsbench.report.data import build, columns_of
from nsbench.report.html_page import shorten_paths
from nsbench.report.scenes import player
from nsbench.report.scenes.files import format_player, player_file, write_scenes
from nsbench.report.stored_results import MAX_SCENE_BYTES, read_player
from nsbench.source_files.regular_files import UnusableFile


ASKED = dict.fromkeys(("pbd", "catching_up"), (0.02, 0.005))


def frames_of(name, solver="pbd", **accuracy):
    case = nsbench.get_case(name)
    traj = nsbench.solve(case, solver, **accuracy)
    states = None if case.exact is None else case.exact(case.t)
    value = next(iter(accuracy.values()))
    return case, traj, player.collect_frames(case, states, [(solver, value, traj)])


def summed(rows, unit):
    return np.array([np.cumsum(row) for row in rows]).T * unit


def test_frames_are_the_states_of_the_run_at_their_times():
    case, traj, found = frames_of("three_discs", h=0.01)
    at = np.searchsorted(traj.t, found["t"])
    np.testing.assert_allclose(found["t"], traj.t[at], rtol=1e-4)
    (run,) = found["runs"]
    stored = summed(run["states"], found["unit"])
    np.testing.assert_allclose(stored, traj.x[at], atol=0.51 * found["unit"])
    assert len(found["t"]) <= player.MAX_FRAMES and found["unit"] < 1e-3 * np.ptp(traj.x)


def test_multipliers_are_the_impulses_over_the_time_between_frames():
    case, traj, found = frames_of("tide", h=0.0125)
    (run,) = found["runs"]
    lam = summed(run["lam"], found["lam_unit"])[1:, 0]
    at = np.searchsorted(traj.t, found["t"])
    want = np.diff(traj.impulse[at, 0]) / np.diff(traj.t[at])
    np.testing.assert_allclose(lam, want, atol=0.51 * found["lam_unit"])
    assert lam.max() == pytest.approx(np.sqrt(0.75), abs=0.03)


def test_violations_are_those_of_all_pairs():
    """Pairs of hard discs are not listed: a count over listed constraints would find none."""
    _, _, found = frames_of("discs", h=0.01)
    (run,) = found["runs"]
    state = summed(run["states"], found["unit"])[-1].reshape(-1, 2)
    pairs = np.linalg.norm(state[:, None] - state, axis=2) + 9.0 * np.eye(len(state))
    assert run["violation"][-1] == pytest.approx(2.0 - pairs.min(), abs=4 * found["unit"])
    assert run["violation"][-1] > 1e-3


@pytest.mark.parametrize(
    "name, kind",
    [("hex", "particles"), ("friction", "plane"), ("obstacle", "plane"), ("tide", "curves")],
)
def test_each_kind_of_case_has_its_drawing(name, kind):
    case = nsbench.get_case(name)
    found = player.build_player(case, None, player.choose_runs(case, {"euler": [0.05], "pbd": [0.05]}))
    assert found["kind"] == kind and ("box" in found) == (kind != "curves")
    assert bool(found.get("lines")) == bool(found.get("arrows")) == (name == "friction")
    assert bool(found.get("region")) == (name == "obstacle")


def test_two_methods_that_take_the_case_are_shown_at_two_steps_of_the_study():
    case = nsbench.get_case("tide")
    steps = [0.05, 0.025, 0.01, 0.005]
    asked = dict.fromkeys(("euler", "no_such_method", "catching_up", "pbd", "theta"), steps)
    runs = [(s, h) for s in ("pbd", "catching_up") for h in (0.05, 0.01)]
    assert player.choose_runs(case, asked) == runs
    assert player.choose_runs(case, {"pbd": [1e-5]}) == []  # too long to be made again
    assert player.choose_runs(case, {"penalty": [1e4, 100.0]}) == [("penalty", 100.0)] + [
        ("penalty", 1e4)
    ]


def test_contacts_know_where_they_act():
    _, _, hexagon = frames_of("hex", h=0.01)
    (run,) = hexagon["runs"]
    assert run["contacts"] and all({"g", "i", "j"} <= set(c) for c in run["contacts"])
    _, _, stack = frames_of("stack", h=0.01)
    walls = [c for c in stack["runs"][0]["contacts"] if "n" in c]
    assert [c["n"] for c in walls] == [[0.0, -1.0]]


def test_the_frames_of_a_failed_run_end_where_its_states_end():
    case = nsbench.get_case("tide")
    traj = nsbench.solve(case, "pbd", h=0.05)
    x = traj.x.copy()
    x[len(x) // 2 :] = np.nan
    impulse = traj.impulse.copy()
    impulse[len(x) // 2 :] = np.nan
    bad = nsbench.Trajectory(
        traj.t, x, traj.contacts, impulse, traj.reaction, nsbench.trajectory.Status("nan", "Why.")
    )
    found = player.collect_frames(case, None, [("pbd", 0.05, bad)])
    (run,) = found["runs"]
    assert len(run["states"][0]) == len(x) // 2 and run["why"] == "Why."
    assert None in run["violation"] and "NaN" not in format_player(found)


def test_a_run_that_left_all_bounds_has_the_frames_before():
    """Such states are finite, and far beyond whole numbers in the units of the reference."""
    case = nsbench.get_case("tide")
    traj = nsbench.solve(case, "pbd", h=0.05)
    x = traj.x.copy()
    x[10:] = 1e200
    wild = nsbench.Trajectory(traj.t, x, (), np.empty((len(x), 0)), traj.reaction)
    found = player.collect_frames(case, case.exact(case.t), [("pbd", 0.05, wild)])
    assert len(found["runs"][0]["states"][0]) == 10
    nothing = nsbench.Trajectory(traj.t, x * np.nan, (), np.empty((len(x), 0)), traj.reaction)
    assert player.collect_frames(case, None, [("pbd", 0.05, nothing)]) is None


def test_frames_are_written_beside_the_scene_with_the_same_bytes(tmp_path):
    case = nsbench.get_case("tide")
    texts = []
    for _ in range(2):
        write_scenes([case], tmp_path, ASKED)
        texts.append((tmp_path / player_file("tide")).read_bytes())
    assert texts[0] == texts[1] and (tmp_path / "scene_tide.svg").exists()
    write_scenes([case], tmp_path, {"euler": [0.05]})  # it refuses: frames of an earlier study go
    assert not (tmp_path / player_file("tide")).exists()


def unpacked(text):
    return json.loads(gzip.decompress(base64.b64decode(text)))


def test_seconds_come_from_the_rows_and_name_the_runs_of_one_budget():
    """The finer step of the cheaper method costs what the coarser one of the other does."""
    case = nsbench.get_case("tide")
    found = player.build_player(case, None, player.choose_runs(case, ASKED))
    prices = {"pbd": 1.0, "catching_up": 4.0}
    rows = [
        row("tide", r["solver"], r["asked"])
        | {"asked": r["asked"], "seconds": 1e-5 * prices[r["solver"]] / r["asked"]}
        for r in found["runs"]
    ]
    data = build(columns_of(rows))
    packed = unpacked(pack_player(found, data.of_case("tide")))
    shown = [packed["runs"][k] for k in packed["budget"]]
    assert [r["solver"] for r in shown] == ["pbd", "catching_up"]
    assert shown[0]["asked"] == pytest.approx(shown[1]["asked"] / 4, rel=0.2)
    assert unpacked(pack_player(found, []))["budget"] is None


def test_frames_that_others_stored_are_checked(tmp_path):
    (tmp_path / "figures").mkdir()
    path = tmp_path / "figures" / "scene_tide.json"
    _, _, found = frames_of("tide", h=0.05)
    path.write_text(format_player(found))
    assert read_player(path) == found
    run = found["runs"][0]
    for wrong in (
        [],
        {**found, "kind": "<b>"},
        {**found, "runs": []},
        {**found, "t": ["x"]},
        {**found, "unit": 0},
        {**found, "unit": float("nan")},
        {**found, "runs": [{**run, "states": [["x"]]}]},
        {**found, "runs": [{**run, "contacts": [{}, {}]}]},
        {**found, "runs": [{**run, "asked": 0}]},
    ):
        path.write_text(json.dumps(wrong))
        with pytest.raises(UnusableFile, match=r"scene_tide\.json"):
            read_player(path)
    path.write_text("1" * (MAX_SCENE_BYTES + 1))
    assert read_player(path) is None
    path.unlink()
    assert read_player(path) is None
    path.symlink_to("/dev/zero")
    with pytest.raises(UnusableFile):
        read_player(path)


def test_show_writes_a_page_of_one_run(tmp_path, capsys):
    file = tmp_path / "run.html"
    assert main(["show", "hex", "-s", "pbd", "--h", "0.01", "--html", str(file)]) == 0
    page = file.read_text(encoding="utf-8")
    assert str(file) in capsys.readouterr().out and "pbd, h = 0.01: ok." in page
    assert "default-src &#39;none&#39;" in page and "vegaEmbed=" not in page
    assert main(["show", "hex", "--html", str(file)]) == 2


def test_paths_of_a_scene_are_shortened_and_nothing_else():
    text = '<text d="1.234">1.234</text>'
    svg = f'<svg>\n <path id="a" d="M 1.26 2.345 \nL 4.95e-1 4"/>\n{text}</svg>'
    short = shorten_paths(svg)
    assert 'd="M1.3 2.3L0.5 4"' in short and text in short


def test_a_report_holds_the_players_of_its_cases(tmp_path):
    import pandas

    (tmp_path / "figures").mkdir()
    pandas.DataFrame([r for r in made() if r["case"] == "tide"]).to_parquet(
        tmp_path / "runs.parquet"
    )
    write_scenes([nsbench.get_case("tide")], tmp_path / "figures", ASKED)
    page = nsbench.write_report(tmp_path).read_text(encoding="utf-8")
    assert page.count('class="player') == 1
