"""Every case has a picture true to scale, of valid XML with harmless text, and of the same bytes on
every machine."""

import os
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Smooth
from nsbench.case import case_names
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.report.scenes import figure as scene
from nsbench.report.scenes import particles, plane
from nsbench.trajectory import Status, Trajectory

ALL = case_names()


def still(xp):
    return lambda t, x: 0.0 * x


def trajectory(case, x, status=Status()):
    none = np.empty((len(x), 0))
    return Trajectory(case.t[: len(x)], x, (), none, np.empty((len(x), case.n)), status)


def words(svg):
    return [
        e.text for e in ElementTree.fromstring(svg).iter() if e.tag.endswith("}text") and e.text
    ]


@pytest.mark.long
@pytest.mark.parametrize("name", ALL)
def test_every_case_is_drawn_the_same_each_time(name):
    case = nsbench.get_case(name)
    svg = scene.scene_svg(case, case.x0, case.key)
    assert svg == scene.scene_svg(case, None, case.key)
    assert words(svg)[-1] == case.key or case.key in words(svg)
    drift = 0.01 * case.t[:, None] * np.ones(case.n)
    frames = scene.frames_svg(case, trajectory(case, case.x0 + drift))
    assert frames == scene.frames_svg(case, trajectory(case, case.x0 + drift))
    for text in (svg, frames):
        assert ElementTree.fromstring(text).tag.endswith("svg")
        assert len(text) < 400_000
        assert "Created with" not in text and "dc:date" not in text


@pytest.mark.long
@pytest.mark.survives("terminal")
def test_the_bytes_do_not_depend_on_the_process_and_no_display_is_needed():
    code = (
        "import sys, nsbench; from nsbench.report.scenes import figure; assert 'matplotlib' not in "
        "sys.modules\n"
        "for n in ('tide', 'hex', 'sliding', 'epithelium'): "
        "print(figure.scene_svg(nsbench.get_case(n)))\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    here = "".join(
        f"{scene.scene_svg(nsbench.get_case(n))}\n"
        for n in ("tide", "hex", "sliding", "epithelium")
    )
    env = {
        k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY", "MPLBACKEND")
    }
    env |= {"PYTHONHASHSEED": "1", "PYTHONUTF8": "1"}
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True, env=env
    )
    assert out.stdout == here


@pytest.mark.survives("names")
@pytest.mark.parametrize(
    "title",
    ['<b>&"$x_1$"</b>', "]]> <!-- --", "\x1b[31mred\x00", "\u6f22\u5b57 \u202e evil", "$\\frac{1}"],
)
def test_titles_are_text_and_nothing_else(title):
    svg = scene.scene_svg(nsbench.get_case("tide"), None, title)
    shown = words(svg)[-1]  # the title is drawn last, after ticks and labels
    assert shown == title or (shown.isprintable() and "\\x" in shown)
    assert not set(svg) & set("\x1b\u202e\x00")


def test_decimals_of_text_are_not_cut():
    assert "t = 0.12345 <" in words(scene.scene_svg(nsbench.get_case("hex"), None, "t = 0.12345 <"))


@pytest.mark.parametrize("name", ["discs", "stack", "chain", "wheel", "sliding", "epithelium"])
def test_scales_are_equal_in_both_directions(name):
    figure = scene.scene_figure(nsbench.get_case(name))
    for ax in figure.axes:
        a, b, c = ax.transData.transform([[0, 0], [1, 0], [0, 1]])
        assert np.linalg.norm(b - a) == pytest.approx(np.linalg.norm(c - a), rel=1e-6)


@pytest.mark.parametrize("name, radius", [("discs", 1.0), ("hex", 1.0), ("chain", 0.1)])
def test_discs_have_their_size_and_lie_inside(name, radius):
    case = nsbench.get_case(name)
    figure = scene.frames_figure(case, trajectory(case, np.tile(case.x0, (len(case.t), 1))))
    assert len(figure.axes) == 3 and figure.get_size_inches()[0] == pytest.approx(
        3 * scene.PANEL_WIDTH
    )
    for ax in figure.axes:
        discs = (
            ax.collections[0]
            if name != "chain"
            else max(ax.collections, key=lambda c: len(c.get_offsets()))
        )
        pixels = np.linalg.norm(np.diff(ax.transData.transform([[0, 0], [radius, 0]]), axis=0))
        assert np.sqrt(discs.get_sizes()[0]) / 2 == pytest.approx(
            pixels * 72 / figure.dpi, rel=1e-6
        )
        assert np.allclose(discs.get_offsets(), case.x0.reshape(-1, 2))
        low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
        assert np.all(discs.get_offsets() - radius > low) and np.all(
            discs.get_offsets() + radius < high
        )


def test_walls_stand_where_the_surfaces_of_the_discs_touch_them():
    case = nsbench.get_case("discs", n=20, box=True)
    walls = particles.find_walls(case, (0, 2, 20), 1.0, 0.0)
    size = case.problem.constraints[1].b[[40, 41]] + 1
    assert np.allclose(walls, sorted([[1, 0, 0], [0, 1, 0], [-1, 0, size[0]], [0, -1, size[1]]]))
    stack = nsbench.get_case("stack", n=4)
    assert particles.find_walls(stack, (0, 2, 4), 1.0, 0.0).tolist() == [[0, 1, 0]]


def test_rows_that_join_particles_are_no_walls():
    A = np.array([[1.0, 0, -2, 0], [0, 0, 0, 2.0]])
    families = (Affine(A, np.array([0.0, 3.0])), Distance(d=2.0))
    case = Case(
        "rows", Complementarity(still, families), np.array([3.0, 0, 0, 0]), np.array([0.0, 1.0])
    )
    assert particles.find_walls(case, (0, 2, 2), 1.0, 0.0).tolist() == [[0, 1, 2.5]]


def test_forbidden_regions_are_those_of_the_constraints():
    line = Smooth(lambda xp: lambda t, x: xp.stack((x[0] + x[1] * x[1] + t, x[1] + 2.0)))
    own = Case(
        "own",
        Complementarity(still, (line, Distance(0.5, anchors=np.ones((1, 2))))),
        np.zeros(2),
        np.array([0.0, 1.0]),
    )
    cases = [
        nsbench.get_case(n) for n in ("wedge", "wheel", "dragged_disc", "play", "moving_floor")
    ] + [own]
    for case in cases:
        points = np.random.default_rng(0).uniform(-2, 2, (50, case.n))
        view = ConstraintSet(case.problem, case.n)
        near = view.all_static()
        want = [view.gaps(0.7, p, near).min() for p in points]
        assert plane.smallest_gap(case, 0.7, points) == pytest.approx(want, abs=1e-13), case.name


def segments(case, x, colour):
    ax = scene.scene_figure(case, x).axes[0]
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgba

    return sum(
        len(c.get_segments())
        for c in ax.collections
        if isinstance(c, LineCollection) and np.allclose(c.get_colors()[0], to_rgba(colour))
    )


def test_overlaps_and_contacts_are_told_apart():
    case = nsbench.get_case("three_discs")
    x = np.array(
        [0, 0, 2.0, 0, 2.0, 1.5]
    )  # one contact, one overlap (of the other pair), one of both
    assert (segments(case, x, particles.BLUE), segments(case, x, particles.RED)) == (1, 1)
    x = np.array([0, 0, 2.5, 0, 5.0, 0])
    assert (segments(case, x, particles.BLUE), segments(case, x, particles.RED)) == (0, 0)


def test_taut_links_are_black_and_slack_ones_grey():
    case = nsbench.get_case("chain")
    links = next(c for c in case.problem.constraints if c.anchors is None)
    x = np.stack((np.arange(case.n // 2) * float(np.min(links.d)), np.zeros(case.n // 2)), 1)
    x[-1, 0] -= 0.5 * float(np.min(links.d))
    assert segments(case, x.ravel(), particles.GREY) >= 1
    assert segments(case, x.ravel(), particles.BLACK) >= case.n // 2 - 2


def test_failed_and_refused_runs_say_so():
    case = nsbench.get_case("hex")
    x = np.tile(case.x0, (len(case.t), 1))
    x[len(x) // 2 :] = np.nan
    said = words(scene.frames_svg(case, trajectory(case, x, Status("nan", "why"))))
    assert said.count("no state: the run failed") == 2
    assert "no run" in words(
        scene.frames_svg(case, trajectory(case, x[:0], Status("refused", "why")))
    )
    for name in ("tide", "sliding"):
        case = nsbench.get_case(name)
        bad = np.full((len(case.t), case.n), np.nan)
        assert "no state: the run failed" in words(scene.frames_svg(case, trajectory(case, bad)))


def test_a_million_discs_are_a_window():
    case = nsbench.get_case("discs", n=20_000)
    svg = scene.scene_svg(case)
    assert len(svg) < 400_000 and "1500 of 20000 discs" in words(svg)


@pytest.mark.parametrize("n, starts", [(2, True), (3, False)])
def test_a_file_of_ones_own_may_draw_itself(tmp_path, n, starts):
    file = tmp_path / "epithelium.py"  # the name of a registered case, whose drawing would not fit
    file.write_text(
        "import numpy as np\nfrom nsbench import Affine, Case, Complementarity\n"
        f"CASE = Case('epithelium', Complementarity(lambda xp: lambda t, x: 0.0 * x, "
        f"(Affine(np.eye({n}), "
        f"np.zeros({n})),)), np.ones({n}), np.array([0.0, 1.0]))\n"
        + "def draw(ax, case, x):\n    ax.text(0, 0, 'my own')\n    ax.plot([0, 1], [0, 2])\n"
        * starts
    )
    case = nsbench.load_case(file)
    assert ("my own" in words(scene.scene_svg(case))) is starts
    assert scene.drawing_kind(case) == ("own" if starts else "curves")


def test_a_known_path_is_drawn_with_its_kinks():
    case = nsbench.get_case("tide")
    times, _ = scene._refine_path(case, case.t, case.exact(case.t))
    assert np.pi / 6 in times and len(times) > 300
    assert scene._refine_path(case, case.t, case.exact(case.t) + 1e-3)[0] is case.t


def test_states_of_another_size_are_refused():
    case = nsbench.get_case("hex")
    for bad in (np.zeros(3), np.zeros((2, case.n)), np.zeros((1, 1, case.n))):
        with pytest.raises(ValueError, match="shape"):
            scene.scene_svg(case, bad)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_near_pairs_of_few_particles_are_those_of_the_kernel(dim):
    """At grid points too, where gaps are exactly the reach."""
    from nsbench.dynamics.contacts.candidates import pairs_brute_force
    from nsbench.dynamics.contacts.kernels.cell_list import near_pairs

    rng = np.random.default_rng(dim)
    for n, reach, grid in (
        (1, 0.5, False),
        (2, 1.0, True),
        (40, 0.3, False),
        (64, 1.0, True),
        (30, np.inf, False),
    ):
        x = rng.integers(0, 9, (n, dim)).astype(float) if grid else rng.normal(size=(n, dim))
        r = np.full(n, 0.5) if grid else rng.uniform(0.0, 0.2, n)
        few = pairs_brute_force(x, r, reach)
        many = near_pairs(x.ravel(), 0, n, dim, r, min(reach, 1e3))
        assert all(np.array_equal(a, b) for a, b in zip(few, many, strict=True)) and (
            n < 40 or few[0].size > 2
        )


def test_near_pairs_of_points_on_a_line_are_those_at_the_same_place():
    """Cells of points without a radius have no width across the line: the division was 0 / 0."""
    from nsbench.dynamics.contacts.kernels.cell_list import near_pairs

    x = np.stack([np.arange(20.0) // 2, np.zeros(20)], axis=1)
    found = near_pairs(x.ravel(), 0, 20, 2, np.zeros(20), 0.0)
    assert np.array_equal(found, [np.arange(0, 20, 2), np.arange(1, 20, 2)])
    one = near_pairs(np.ones(8), 0, 4, 2, np.zeros(4), 0.0)
    assert len(one[0]) == 6
