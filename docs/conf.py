"""Sphinx's settings of the site.  docs/build.py assembles its pages and calls Sphinx."""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext")]

import dea_fenicsx  # noqa: E402

project = "dea_fenicsx"
author = "the dea_fenicsx authors"
project_copyright = author
version = release = dea_fenicsx.__version__
language = "en"
smartquotes = False  # two hyphens before an option stay two
highlight_language = "text"

# mathml and public_names are in docs/_ext.
extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "public_names",
]  # fmt: skip
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False
myst_number_code_blocks = []

# Formulas become MathML while the site is built: a page needs no script for them.
html_math_renderer = "mathml"

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"
# Attributes of different classes may have one name; in prose they are not meant as links.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_title = "dea_fenicsx"
html_static_path = [str(DOCS / "_static")]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
# A summary of each hit would be fetched.  Browsers refuse this for pages opened from a disk.
html_show_search_summary = False
pygments_style = "friendly"
pygments_dark_style = "monokai"
