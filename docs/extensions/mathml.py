"""Formulas as MathML, converted by docutils at build time: the pages need no script for them."""

from docutils.utils.math import latex2mathml
from sphinx.errors import SphinxError


def convert(tex, display):
    """Convert LaTeX to the text of a <math> element; raise for what cannot be converted."""
    try:
        element = latex2mathml.tex2mathml(tex, as_block=display)
    except Exception as e:
        raise SphinxError(f"formula {tex!r} cannot be converted: {e}") from e
    return element


def visit_inline(self, node):
    """Write a formula within a line."""
    from docutils.nodes import SkipNode

    self.body.append(convert(node.astext(), display=False))
    raise SkipNode


def visit_block(self, node):
    """Write a formula of its own."""
    from docutils.nodes import SkipNode

    self.body.append(convert(node.astext(), display=True))
    raise SkipNode


def setup(app):
    """Register the converter as the renderer of formulas."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.connect("config-inited", lambda _, config: setattr(config, "html_math_renderer", "mathml"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
