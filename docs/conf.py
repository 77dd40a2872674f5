"""Configuration of the documentation: `sphinx-build -W -b html docs DIR`, without a network."""

import sys
from pathlib import Path

import nsbench

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "nsbench"
author = "the nsbench developers"
project_copyright = author
version = nsbench.__version__
release = version

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "extensions.mathml",
    "extensions.plain_docstrings",
    "extensions.catalogue",
    "extensions.command_line",
    "extensions.method_choice",
]
exclude_patterns = ["extensions", "**.ipynb_checkpoints"]
nitpicky = True

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence", "attrs_inline"]
myst_heading_anchors = 4
myst_links_external_new_tab = True
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
# charts come as SVG beside their specification: pages show the SVG and need no script
suppress_warnings = ["mystnb.unknown_mime_type"]

autodoc_typehints = "none"  # types stand in the signature of the source, in short words
autodoc_member_order = "bysource"
autosummary_generate = False

html_theme = "pydata_sphinx_theme"
html_title = "nsbench"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_toc_level": 2,
}
