"""Docstrings of nsbench are plain text; autodoc reads reStructuredText.

Paragraphs are escaped, `word` becomes a literal, and what is laid out by columns or indented (an
equation, a list of attributes, an example) is shown as it stands.
"""

import re
import textwrap

SPECIAL = re.compile(r"([\\*|_`<>])")
LITERAL = re.compile(r"``?([^`\n]+)``?")
COLUMNS = re.compile(r"\S {2,}\S")


def as_rst(text):
    """Convert a docstring to lines of reStructuredText."""
    out = []
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        lines = paragraph.splitlines()
        laid_out = any(line.startswith(" ") for line in lines) or any(map(COLUMNS.search, lines))
        if paragraph.lstrip().startswith(">>>"):
            out += ["", *lines, ""]
        elif laid_out and lines:
            out += ["", "::", "", *textwrap.indent(paragraph, "   ").splitlines(), ""]
        else:
            out += ["", *escape(paragraph).splitlines(), ""]
    return out


def escape(text):
    """Escape what reStructuredText reads; `literals` stay literals."""
    out = []
    for index, part in enumerate(LITERAL.split(text)):
        if index % 2:
            out.append(f"``{part}``")
            continue
        # what follows a literal without a space is set apart from it
        apart = "\\ " if index and re.match(r"[\w(]", part) else ""
        out.append(apart + SPECIAL.sub(r"\\\1", part))
    return "".join(out)


def process(app, what, name, obj, options, lines):
    """Replace the lines that autodoc read."""
    lines[:] = as_rst("\n".join(lines))


def setup(app):
    """Convert every docstring before it is read."""
    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True}
