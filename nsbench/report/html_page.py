"""The report as one HTML file that needs nothing else, rendered by Jinja2 from ``templates/``.

This module only prepares data; all markup is in the templates, the style sheet and the scripts in
``static/``, and all are written into the page. Jinja2 escapes every text (autoescape) and fails
on a name that is not defined. Inserted as they are: the SVG that this package draws, the files of
``static/`` and the library that draws the interactive charts. Scenes were stored by another run:
they are embedded as images, in which a browser runs no script. The page's content security policy
allows nothing but these: scripts and styles are named by their SHA-256 digests, images are data.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from nsbench.columns import ABSOLUTE
from nsbench.report.answers.best_method import RULE
from nsbench.report.charts.files import chart_library
from nsbench.report.charts.payload import encode_payload, pack_player
from nsbench.report.content import (
    MEASURED,
    TRUST_TABLES,
    Content,
    describe_problem,
    split_docstring,
)
from nsbench.report.cost import COMPARISON_RULE
from nsbench.report.study_pages import StudySection
from nsbench.report.style import DARK, DARK_THEME, LIGHT_THEME, PALETTE, SHAPES, Look
from nsbench.report.summary import Summary, without_refusals
from nsbench.report.svg_plots import DASHES, define_markers, inline_svg
from nsbench.report.tables.reliability_tables import describe_reference

FOLDER = Path(__file__).parent
SECTIONS = (  # id, also the name of the template; heading
    ("answer", "Which method?"),
    ("verdict", "What the runs say"),
    ("explore", "Error against step and cost"),
    ("studies", "Studies: questions and answers"),
    ("speed", "Speed at equal error"),
    ("orders", "Orders"),
    ("trust", "What the numbers rest on"),
    ("failures", "Failures and refusals"),
    ("cases", "Case by case"),
    ("talk", "The talk's figure"),
    ("environment", "Repeat, cite; machine, versions, words"),
)
LINKED_TABLES = {  # tables to whose rows the section of a case leads, and the words of the link
    "orders": "orders and best errors",
    "errors": "errors and residuals at the finest step",
    "references": "the reference and how far to rely on it",
}
STYLES = ("page.css", "interactive.css")
PLAYER_SCRIPTS = ("charts.js", "scenes.js", "player.js", "start.js")  # of a page with one player
SCRIPTS = ("page.js", "chosen.js", "answer.js", "explore.js", "save.js", *PLAYER_SCRIPTS)
_URI_SAFE = " !$()*+,-./:;=?@[]^_`{|}~"  # characters that stay as they are in a data URI
WIDE_ASPECT = 2.5  # width over height of a scene of frames side by side: above the text
BROAD_ASPECT = 1.5  # of a plane: beside the text, but broader than a box of particles


@dataclass(frozen=True)
class Fit:
    """One method on one case: what was fitted, or why nothing could be."""

    solver: str
    sentence: str


@dataclass(frozen=True)
class CaseSection:
    """One case as the template shows it.

    places: pairs (key, words) of the tables that have rows of the case. scene: a data URI or "";
    layout: "", "broad" or "wide". player: packed frames or "". methods: pairs (name, look) of the
    legend. panels: SVG elements. reference: its own error in a sentence.
    """

    name: str
    id: str
    meta: str
    places: list[tuple[str, str]]
    scene: str
    layout: str
    player: str
    paragraph: str
    equations: str
    notes: list[str]
    reference: str
    methods: list[tuple[str, Look]]
    panels: list[str]
    fits: list[Fit]


@dataclass(frozen=True)
class StudyHeader:
    """Title and first line of the page of one study."""

    title: str
    lede: str


def render_page(content: Content) -> str:
    """Render the whole HTML document."""
    looks = content.looks
    optional = {"talk": content.talk, "studies": content.studies}
    return _render(
        content=content,
        looks=looks,
        case_ids=content.ids,
        payload=encode_payload(content),
        sections=[s for s in SECTIONS if optional.get(s[0], True)],
        cases=[prepare_case(content, case) for case in content.data.case_keys],
        studies=content.studies,
        trust_tables=TRUST_TABLES,
        comparison_rule=COMPARISON_RULE,
        best_rule=RULE,
        absolute=ABSOLUTE,
        measured=MEASURED,
    )


def render_study_page(study: StudySection, title: str = "", heading: str = "") -> str:
    """Render the HTML document of one section alone, by default under the title of a study."""
    studies = next(s for s in SECTIONS if s[0] == "studies")
    return _render(
        content=StudyHeader(title or f"nsbench study {study.name}", study.note),
        looks={},
        case_ids={},
        payload="",
        sections=[(studies[0], heading or studies[1])],
        cases=[],
        studies=(study,),
    )


def render_player_page(title: str, lede: str, player: dict) -> str:
    """Render the HTML document of one player alone."""
    style = Markup("\n").join([*_theme_rules(), *map(_read_static, STYLES)])
    script = Markup("\n").join(map(_read_static, PLAYER_SCRIPTS))
    page = _environment().get_template("player_page.html").render(
        title=title,
        lede=lede,
        player_frames=pack_player(player, []),
        style=style,
        script=script,
        policy=content_security_policy([style], [script]),
    )
    return page + "\n"


def _theme_rules() -> list[Markup]:
    """Write the style rules of the colours of a light and a dark page."""
    marks = _environment().get_template("_marks.html").module
    light = Markup(":root { %s }") % marks.root_colours(LIGHT_THEME, PALETTE)
    dark = Markup("@media (prefers-color-scheme: dark) { :root { %s } }")
    return [light, dark % marks.root_colours(DARK_THEME, DARK)]


def _render(looks: dict[str, Look], payload: str, **names) -> str:
    """Render the page with these names, the markers of the methods and the sentence splitter."""
    definitions = f'<svg class="defs" width="0" height="0">{define_markers(looks.values())}'
    rules = [*_theme_rules(), *map(_read_static, STYLES), Markup(_marker_rules(looks.values()))]
    style = Markup("\n").join(rules)
    scripts = [name for name in SCRIPTS if payload or name == "page.js"]
    script = Markup("\n").join(map(_read_static, scripts))
    library = Markup(chart_library() if payload else "")
    page = _environment().get_template("page.html").render(
        looks=looks,
        anchors=name_anchors(looks, names["case_ids"]),
        payload=payload,
        style=style,
        script=script,
        library=library,
        policy=content_security_policy([style], [script, library]),
        markers=Markup(inline_svg(f"{definitions}</svg>", {}, "", is_hidden=True)),
        split_sentence=sentence_splitter(looks),
        study_names=[study.name for study in names["studies"]],
        **names,
    )
    return page + "\n"


def name_anchors(looks: dict[str, Look], case_ids: dict[str, str]) -> dict[str, str]:
    """Name what stands in the ids of rows for a method or a case, such as ``citations-m3``."""
    return {name: f"m{look.index}" for name, look in looks.items()} | case_ids


@functools.cache
def _environment() -> Environment:
    """Set up Jinja2 with what is the same for every report."""
    environment = Environment(
        loader=FileSystemLoader(FOLDER / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = allow_breaks
    environment.filters["data_uri"] = _data_uri
    environment.filters["relate_points"] = relate_points
    environment.globals |= {
        "shapes": SHAPES,
        "dashes": DASHES,
        "linked_tables": tuple(LINKED_TABLES),
    }
    return environment


def content_security_policy(styles: list[str], scripts: list[str]) -> str:
    """Write the policy that allows these styles and scripts, images inside the page, nothing else.

    Source: W3C, Content Security Policy Level 3, section 2.3.1 (hash sources).
    """
    digest = lambda text: base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    name = lambda texts: " ".join(f"'sha256-{digest(t)}'" for t in texts if t)
    return (
        f"default-src 'none'; img-src data:; style-src {name(styles)}; script-src {name(scripts)}; "
        "base-uri 'none'; form-action 'none'"
    )


def _marker_rules(looks: Iterable[Look]) -> str:
    """Write the style rules of the classes by which inlined panels name their markers."""
    kinds = [f"{kind}:{look.index}" for look in looks for kind in "mox"]
    return "\n".join(f".{k.replace(':', '-')} {{ marker: url(#{k}); }}" for k in kinds)


def _read_static(name: str) -> Markup:
    return Markup((FOLDER / "static" / name).read_text(encoding="utf-8").strip())


def allow_breaks(name: str) -> Markup:
    """Escape the name of a case or method and let it break after ``_``, ``[`` and ``,``."""
    return Markup("<wbr>").join(re.split(r"(?<=[_\[,])", name))


def sentence_splitter(looks: dict[str, Look]) -> Callable[[str], list[tuple[str, str]]]:
    """Return a function that splits a sentence into pairs (kind, part).

    kind: "method" for the name of a method in `looks`, "study" for a name after ``study`` in
    backquotes, "number" for one with a negative exponent, else "text". Longer names are matched
    first, and no part of a longer word is taken for a name.
    """
    names = "|".join(re.escape(name) for name in sorted(looks, key=len, reverse=True))
    number = r"(\d[\d.]*e-\d+)"
    # without methods nothing is marked, not even numbers
    method = re.compile(rf"(?<![\w\[=,])({names})(?![\w\[=])") if looks else None

    def split(sentence: str) -> list[tuple[str, str]]:
        parts = []
        for i, piece in enumerate(re.split(r"(?<=\bstudy )`(\w+)`", sentence)):
            parts += [("study", piece)] if i % 2 else split_names(piece)
        return parts

    def split_names(sentence: str) -> list[tuple[str, str]]:
        if method is None:
            return [("text", sentence)]
        parts = []
        for i, outer in enumerate(method.split(sentence)):
            if i % 2:
                parts.append(("method", outer))
                continue
            for j, inner in enumerate(re.split(number, outer)):
                parts.append(("number" if j % 2 else "text", inner))
        return parts

    return split


def prepare_case(content: Content, case: str) -> CaseSection:
    """Collect what the template shows of one case."""
    runs = content.data.of_case(case)
    stored = content.data.cases.get(case, {})
    paragraph, equations = split_docstring(stored.get("doc"))
    scene = content.data.pictures.get(case)
    shown = [r.solver for r in runs if content.summaries[case, r.solver].word != "refused"]
    return CaseSection(
        name=case,
        id=content.ids[case],
        meta=describe_problem(stored, runs),
        places=[
            (key, words)
            for key, words in LINKED_TABLES.items()
            if any(case in (row.group, row.anchor) for row in content.tables[key].rows)
        ],
        scene="" if scene is None else _data_uri(shorten_paths(scene)),
        layout="" if scene is None else _layout(scene),
        player=pack_player(content.data.players.get(case), runs),
        paragraph=paragraph,
        equations=equations,
        notes=content.notes[case],
        reference=describe_reference(content.data, case, content.is_unique(case)),
        methods=[(solver, content.looks[solver]) for solver in shown],
        panels=content.panels[case],
        fits=[
            Fit(solver, _explain_fit(summary))
            for (key, solver), summary in without_refusals(content.summaries).items()
            if key == case
        ],
    )


def _explain_fit(summary: Summary) -> str:
    if summary.outcome:
        return summary.outcome
    orders = (summary.state, summary.force, summary.violation)
    return " ".join(order.sentence for order in orders)


def shorten_paths(svg: str) -> str:
    """Write the paths of an SVG with one decimal and without needless spaces.

    A tenth of a point is not visible in a scene of 280 pixels, and a quarter of the bytes.
    """

    def rounded(number: re.Match) -> str:
        return f"{float(number[0]):.1f}".removesuffix(".0")

    def shorter(match: re.Match) -> str:
        path = re.sub(r"\s*([A-Za-z])\s*", r"\1", re.sub(r"\s+", " ", match[2]).strip())
        path = re.sub(r"-?\d+\.\d+(e-?\d+)?", rounded, path)
        return f'{match[1]}"{path}"'

    return re.sub(r'(<path\b[^>]*?\sd=)"([^"<>]*)"', shorter, re.sub(r">\n\s*<", "><", svg))


def relate_points(svg: str) -> str:
    """Write each polygon of a panel from point to point, in the same tenths.

    Points lie near each other: their distances have fewer digits than their places.
    """
    return re.sub(r' d="((?:[ML]-?[\d.]+ -?[\d.]+)+)"', _relate, svg)


def _relate(match: re.Match) -> str:
    parts = []
    last = ""
    x = y = 0
    for letter, a, b in re.findall(r"([ML])(\S+?) ([^ML]+)", match[1]):
        to_x, to_y = (round(10 * float(v)) for v in (a, b))
        moves = letter == "M"
        numbers = (to_x, to_y) if moves else (to_x - x, to_y - y)
        first, second = map(_tenths, numbers)
        letter = "M" if moves else "l"
        command = letter if moves or last != letter else "" if first[0] == "-" else " "
        parts.append(f"{command}{first}{'' if second[0] == '-' else ' '}{second}")
        x = to_x
        y = to_y
        last = letter
    return f' d="{"".join(parts)}"'


def _tenths(count: int) -> str:
    """Write a number of tenths without needless digits: 0, 12, .5, -3.4."""
    text = f"{count / 10:.1f}".removesuffix(".0")
    return text.replace("0.", ".") if abs(count) < 10 else text


def _data_uri(svg: str) -> str:
    """An SVG as a data URI; percent signs where they must be take less room than base64."""
    return f"data:image/svg+xml,{quote(svg, safe=_URI_SAFE)}"


def _layout(svg: str) -> str:
    """Choose the class of a scene by its shape: frames side by side, a plane, a box."""
    aspect = _aspect(svg)
    if aspect > WIDE_ASPECT:
        return "wide"
    return "broad" if aspect > BROAD_ASPECT else ""


def _aspect(svg: str) -> float:
    """Width over height of an SVG by its viewBox; 1 if it has none."""
    box = re.search(r'viewBox="([^"]*)"', svg)
    try:
        _, _, width, height = (float(v) for v in box[1].replace(",", " ").split())
        return width / height
    except (TypeError, ValueError, ZeroDivisionError):
        return 1.0
