"""Directive `case-gallery`: a card for every registered case, with the picture of its start."""

import html
import re
import warnings
from pathlib import Path

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from nsbench.case import case_names, get_case


class CaseGallery(SphinxDirective):
    """Insert the cards of all cases, by problem class."""

    def run(self):
        """Write the pictures beside the pages and return the cards."""
        app = self.env.app
        folder = Path(app.outdir) / "_images" / "cases"
        folder.mkdir(parents=True, exist_ok=True)
        depth = self.env.docname.count("/")
        cases = [get_case(name) for name in case_names()]
        out = []
        for kind in sorted({type(c.problem).__name__ for c in cases}):
            chosen = [c for c in cases if type(c.problem).__name__ == kind]
            section = nodes.section(ids=[f"cases-{kind.lower()}"])
            section += nodes.title(text=f"{kind} ({len(chosen)})")
            cards = "\n".join(card(c, write_picture(c, folder), "../" * depth) for c in chosen)
            section += nodes.raw("", f'<div class="gallery">{cards}</div>', format="html")
            out.append(section)
        return out


def write_picture(case, folder):
    """Write the picture of the start; return the name of its file, "" if none can be drawn."""
    from nsbench.report.scenes.figure import scene_svg

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            text = scene_svg(case)
    except Exception:  # a case may bring its own drawing; the card then has no picture
        return ""
    name = f"{case.name}.svg"
    (folder / name).write_text(text, encoding="utf-8")
    return name


def card(case, picture, root):
    """Return the card of a case as HTML: picture, name, first line, equations, tags."""
    first, equations = summary(case.doc)
    source = f"{root}_images/cases/{picture}"
    image = (
        f'<img src="{source}" alt="start of {html.escape(case.key)}" loading="lazy">'
        if picture
        else '<div class="no-picture">no picture of the start</div>'
    )
    tags = ", ".join(case.tags)
    return (
        f'<figure id="case-{case.name}">{image}<figcaption>'
        f"<code>{html.escape(case.key)}</code> n = {case.n}<br>{html.escape(first)}"
        f"{f'<pre>{html.escape(equations)}</pre>' if equations else ''}"
        f'<span class="tags">{html.escape(tags)}</span></figcaption></figure>'
    )


def summary(doc):
    """Return the first line of a docstring without the name, and its first indented block."""
    paragraphs = re.split(r"\n\s*\n", doc.strip())
    first = " ".join(paragraphs[0].split())
    first = re.sub(r"^[\w ]{1,30}: ", "", first)
    indented = [p for p in paragraphs[1:] if p.startswith("    ")]
    lines = indented[0].splitlines() if indented else []
    return first, "\n".join(line.strip() for line in lines)


def setup(app):
    """Register the directive."""
    app.add_directive("case-gallery", CaseGallery)
    return {"parallel_read_safe": True}
