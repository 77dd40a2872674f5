"""The film of a run: its frames, their limits, the same bytes twice, what has no film."""

import io

import numpy as np
import pytest
from PIL import Image

import nsbench
from nsbench import cli
from nsbench.report.scenes.film import MOST_FRAMES, film_gif


@pytest.mark.parametrize("key, spec, h", [("sliding", "euler", 0.1), ("tide", "pbd", 0.1)])
def test_a_film_has_a_frame_for_each_sample_and_the_same_bytes_twice(key, spec, h):
    case = nsbench.get_case(key)
    traj = nsbench.solve(case, spec, h=h)
    film = film_gif(case, traj)
    frames = Image.open(io.BytesIO(film))
    assert frames.n_frames == min(len(traj.t), MOST_FRAMES) and frames.info["loop"] == 0
    assert film == film_gif(case, traj)
    first = np.asarray(frames.convert("RGB"))
    frames.seek(frames.n_frames - 1)
    assert np.any(first != np.asarray(frames.convert("RGB")))


def test_the_whole_film_lies_within_the_limits_of_each_frame():
    """A particle that falls is in the first picture above where it is in the last one."""
    case = nsbench.get_case("discs", n=3)
    traj = nsbench.solve(case, "pbd", h=0.01)
    frames = Image.open(io.BytesIO(film_gif(case, traj)))
    inked = []
    for k in (0, frames.n_frames - 1):
        frames.seek(k)
        pixels = np.asarray(frames.convert("RGB")).astype(int)
        blue = pixels[..., 2] - pixels[..., 0] > 40
        rows, columns = np.nonzero(blue)
        inked.append((rows.min(), rows.max(), columns.min(), columns.max()))
        assert 0 < rows.min() and rows.max() < pixels.shape[0] - 1
        assert 0 < columns.min() and columns.max() < pixels.shape[1] - 1
    assert inked[0] != inked[1]


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
