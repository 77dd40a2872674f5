"""The film of a run: its frames, their limits, the same bytes twice, what has no film."""

import io

import numpy as np
import pytest
from PIL import Image

import nsbench
from nsbench import cli
from nsbench.report.scenes import film
from nsbench.report.scenes.figure import film_panel
from nsbench.report.scenes.film import MOST_FRAMES, film_gif
from nsbench.study.plan import resolve


@pytest.mark.parametrize("key, spec, h", [("sliding", "euler", 0.1), ("tide", "pbd", 0.1)])
def test_a_film_has_a_frame_for_each_sample_and_the_same_bytes_twice(key, spec, h):
    case = nsbench.get_case(key)
    traj = nsbench.solve(case, spec, h=h)
    written = film_gif(case, traj)
    frames = Image.open(io.BytesIO(written))
    assert frames.n_frames == min(len(traj.t), MOST_FRAMES) and frames.info["loop"] == 0
    assert written == film_gif(case, traj)
    first = np.asarray(frames.convert("RGB"))
    frames.seek(frames.n_frames - 1)
    assert np.any(first != np.asarray(frames.convert("RGB")))


@pytest.mark.parametrize("key, spec", [("sliding", "euler"), ("discs[n=3]", "pbd")])
def test_all_frames_have_the_limits_of_the_whole_film(key, spec):
    traj = nsbench.solve(key, spec, h=0.05)
    frames = film._frames(traj)
    case = resolve(key)
    panels = [film_panel(case, frame, frames).axes[0] for frame in (frames[0], frames[-1])]
    assert panels[0].viewLim.extents.tolist() == panels[1].viewLim.extents.tolist()
    alone = film_panel(case, frames[0], []).axes[0]
    assert alone.viewLim.extents.tolist() != panels[0].viewLim.extents.tolist()


def test_a_run_without_samples_has_no_film(tmp_path, capsys):
    case = nsbench.get_case("sliding")
    with pytest.raises(ValueError, match="two samples"):
        film_gif(case, nsbench.solve(case, "pbd", h=0.1))
    assert cli.main(["show", "sliding", "--gif", str(tmp_path / "f.gif")]) == 2
    assert "name its solver" in capsys.readouterr().err


def test_the_command_writes_it(tmp_path, capsys):
    path = tmp_path / "film.gif"
    assert cli.main(["show", "sliding", "-s", "euler", "--h", "0.1", "--gif", str(path)]) == 0
    assert path.read_bytes().startswith(b"GIF89a") and str(path) in capsys.readouterr().out
