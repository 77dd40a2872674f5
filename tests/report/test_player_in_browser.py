"""Players in a browser: frames move, two runs stand beside each other, the budget can be shared."""

import io
import json

import pytest
from report_rows import row

import nsbench
from nsbench import write_report
from nsbench.cli import main
from nsbench.report.scenes.files import scene_file, write_scenes
from nsbench.report.scenes.player import choose_runs

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
METHODS = ("pbd", "catching_up")
CASES = ("discs[n=10]", "obstacle", "tide")
PRICES = {"pbd": 1.0, "catching_up": 4.0}  # of a step, so that one budget is two steps
PLAYER = '[id="discs_n_10"] .player'


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The page of a study of three cases, each drawn in another way, as an address."""
    import pandas

    out = tmp_path_factory.mktemp("players")
    (out / "figures").mkdir()
    rows = []
    known = {}
    for name in CASES:
        parameters = {"n": 10} if "discs" in name else {}
        case = nsbench.get_case(name.partition("[")[0], **parameters)
        asked = {s: [0.02 * case.t[-1] / k for k in (4, 16)] for s in METHODS}
        write_scenes([case], out / "figures", asked)
        known[name] = {"doc": case.doc, "n": case.n, "picture": f"figures/{scene_file(case.key)}"}
        for solver, h in choose_runs(case, asked):
            seconds = 1e-5 * PRICES[solver] / h
            rows.append(row(name, solver, h) | {"asked": h, "seconds": seconds, "state_sup": h})
    pandas.DataFrame(rows).to_parquet(out / "runs.parquet")
    (out / "cases.json").write_text(json.dumps(known))
    return write_report(out).as_uri()


@pytest.fixture
def page(open_page):
    """The page with the player of the discs made."""
    opened = open_page()
    show(opened, PLAYER)
    return opened


def show(page, player):
    page.wait_for_selector(player, state="attached")
    page.locator(player).scroll_into_view_if_needed()
    page.wait_for_selector(f"{player}[data-ready]")


def pixels(page, k=0, kind="frame", player=PLAYER):
    """What is drawn on a canvas of one of the views."""
    return page.locator(f"{player} canvas.{kind}").nth(k).evaluate("canvas => canvas.toDataURL()")


def colours(page, k=0):
    """Numbers of red, blue and orange pixels of a scene: overlaps, discs, loads."""
    return page.locator(f"{PLAYER} canvas.frame").nth(k).evaluate(
        """canvas => {
            const { width, height } = canvas;
            const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
            const found = { red: 0, blue: 0, orange: 0 };
            for (let p = 0; p < data.length; p += 4) {
                const [r, g, b, a] = data.slice(p, p + 4);
                found.red += a > 200 && r > 140 && g < 60 && b < 60;
                found.blue += a > 200 && r < 60 && b > 140;
                found.orange += a > 200 && r > 190 && g > 70 && g < 120 && b < 40;
            }
            return found;
        }"""
    )


def scrub(page, share, player=PLAYER):
    """Move the scrubber to a share of its way."""
    page.locator(f"{player} input[type=range]").evaluate(
        """(input, share) => {
            input.value = Math.round(share * input.max);
            input.dispatchEvent(new Event("input"));
        }""",
        share,
    )


def chosen(page):
    return page.locator(f"{PLAYER} select").evaluate_all(
        "all => all.map((one) => one.selectedOptions[0].textContent)"
    )


@pytest.mark.long
def test_players_say_nothing_and_fetch_nothing(page, file):
    for element in ("discs_n_10", "obstacle", "tide"):
        show(page, f'[id="{element}"] .player')
        scrub(page, 0.7, f'[id="{element}"] .player')
    page.wait_for_timeout(200)
    assert page.said == []
    assert [url for url in page.requests if not url.startswith("data:")] == [file]


@pytest.mark.long
@pytest.mark.parametrize("element", ["discs_n_10", "obstacle", "tide"])
def test_the_scrubber_changes_frame_time_and_multipliers(open_page, element):
    page = open_page()
    player = f'[id="{element}"] .player'
    show(page, player)
    before = [pixels(page, 0, kind, player) for kind in ("frame", "multipliers")]
    scrub(page, 0.6, player)
    after = [pixels(page, 0, kind, player) for kind in ("frame", "multipliers")]
    assert all(a != b for a, b in zip(before, after, strict=True))
    assert page.inner_text(f"{player} output") not in ("", "t = 0")


def test_the_keyboard_moves_the_time_and_not_the_case(page):
    page.focus(f"{PLAYER} input[type=range]")
    top = page.evaluate("scrollY")
    page.keyboard.press("ArrowRight")
    later = page.inner_text(f"{PLAYER} output")
    page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(100)
    assert later != "t = 0" and page.inner_text(f"{PLAYER} output") == "t = 0"
    assert page.evaluate("scrollY") == top and page.evaluate("location.hash") == ""


@pytest.mark.long
def test_a_run_plays_until_it_is_paused(page):
    page.focus(f"{PLAYER} .play")
    assert page.inner_text(f"{PLAYER} .play") == "Play"
    page.keyboard.press("Enter")
    playwright.expect(page.locator(f"{PLAYER} output")).not_to_have_text("t = 0")
    assert page.inner_text(f"{PLAYER} .play") == "Pause"
    page.keyboard.press("Enter")
    time = page.inner_text(f"{PLAYER} output")
    page.wait_for_timeout(250)
    assert page.inner_text(f"{PLAYER} output") == time


@pytest.mark.long
def test_a_player_is_made_when_it_is_seen_and_stops_out_of_sight(open_page):
    page = open_page()
    last = '[id="tide"] .player'
    page.wait_for_selector(last, state="attached")
    page.wait_for_timeout(300)
    assert page.locator(f"{last} canvas").count() == 0
    show(page, last)
    page.click(f"{last} .play")
    playwright.expect(page.locator(f"{last} .play")).to_have_text("Pause")
    page.evaluate("scrollTo(0, 0)")
    playwright.expect(page.locator(f"{last} .play")).to_have_text("Play")
    assert float(page.locator(f"{last} output").text_content().split()[-1]) < 1.5  # of 3


@pytest.mark.long
def test_two_methods_stand_beside_each_other_with_the_reference_as_a_ghost(page):
    scrub(page, 0.8)
    assert [words.split(",")[0] for words in chosen(page)] == list(METHODS)
    boxes = [page.locator(f"{PLAYER} canvas.frame").nth(k).bounding_box() for k in (0, 1)]
    assert boxes[0]["y"] == boxes[1]["y"] and boxes[0]["x"] + boxes[0]["width"] <= boxes[1]["x"]
    assert pixels(page, 0) != pixels(page, 1)
    pbd, other = colours(page, 0), colours(page, 1)
    assert pbd["red"] > 50 and other["red"] == 0 and other["blue"] > 50  # PBD overlaps
    assert pbd["orange"] > 50 and other["orange"] > 50  # contacts that carry load
    captions = page.locator(f"{PLAYER} .note").all_text_contents()
    assert all("error" in words and "violation" in words for words in captions)


def test_the_ghost_is_the_reference(page):
    scrub(page, 0.5)
    drawn = pixels(page)
    page.evaluate("player.all.forEach((one) => { one.data.ghost = null; one.draw(); })")
    assert pixels(page) != drawn


def test_one_budget_gives_the_cheaper_method_the_finer_step(page):
    def steps():
        found = page.evaluate(
            """() => {
                const [one] = [...player.all].filter((p) => p.button.closest("#discs_n_10"));
                return one.pair.map((k) => one.data.runs[k])
                    .map((run) => [run.solver, run.asked, run.seconds]);
            }"""
        )
        return {solver: (asked, seconds) for solver, asked, seconds in found}

    scrub(page, 0.8)
    same = steps()
    drawn = pixels(page)
    assert same["pbd"][0] == same["catching_up"][0]
    page.check(f"{PLAYER} .budget")
    budget = steps()
    assert budget["pbd"][0] == pytest.approx(budget["catching_up"][0] / 4, rel=0.2)
    assert budget["pbd"][1] == pytest.approx(budget["catching_up"][1], rel=0.2)
    assert pixels(page) != drawn and chosen(page)[0] != chosen(page)[1]
    page.uncheck(f"{PLAYER} .budget")
    assert steps() == same and pixels(page) == drawn


def test_any_two_runs_can_be_chosen(page):
    scrub(page, 0.8)
    page.locator(f"{PLAYER} select").nth(1).select_option("0")
    assert pixels(page, 0) == pixels(page, 1) and len(set(chosen(page))) == 1


@pytest.mark.long
def test_dark_mode_draws_again(page):
    drawn = pixels(page)
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(200)
    assert pixels(page) != drawn and page.said == []


@pytest.mark.long
def test_a_phone_has_the_views_below_each_other(open_page):
    page = open_page()
    page.set_viewport_size({"width": 390, "height": 844})
    show(page, PLAYER)
    boxes = [page.locator(f"{PLAYER} canvas.frame").nth(k).bounding_box() for k in (0, 1)]
    assert boxes[1]["y"] > boxes[0]["y"] + boxes[0]["height"]
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_without_scripts_the_film_strip_stays(open_page):
    page = open_page(java_script_enabled=False)
    assert page.locator('[id="discs_n_10"] img.scene').is_visible()


def test_the_page_of_one_run_plays(open_page, tmp_path):
    file = tmp_path / "run.html"
    assert main(["show", "discs[n=10]", "-s", "pbd", "--h", "0.01", "--html", str(file)]) == 0
    page = open_page(file.as_uri())
    show(page, ".player")
    before = pixels(page, player=".player")
    scrub(page, 0.5, ".player")
    assert pixels(page, player=".player") != before and page.said == []
    assert page.locator(".player canvas.frame").count() == 1


@pytest.mark.long
def test_stored_figures_are_dark_on_a_dark_page_and_bright_on_paper(open_page):
    """A corner of the figure, its white ground, against the ground of the page around it."""
    page = open_page(color_scheme="dark")
    page.locator("article", has=page.locator(".about noscript")).first.scroll_into_view_if_needed()
    scene = page.locator("img.scene").first
    assert lightness(scene) < 0.15
    page.emulate_media(color_scheme="light")
    assert lightness(scene) > 0.95
    page.emulate_media(color_scheme="dark", media="print")
    assert scene.evaluate("figure => getComputedStyle(figure).filter") == "none"


def lightness(figure):
    """The lightness, 0 to 1, of the upper left corner of an element as it is seen."""
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    seen = image.open(io.BytesIO(figure.screenshot())).convert("L")
    return seen.getpixel((6, 6)) / 255
