"""Sphinx configuration of the site; `tools/build_site.py` uses it."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "python")]

import ballbot_rs  # noqa: E402

project = "ballbot"
author = "The ballbot authors"
version = release = ballbot_rs.__version__
html_title = f"ballbot {version}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "website.mathematics",
    "website.sources",
    "website.signatures",
]
root_doc = "index"
default_role = "code"
highlight_language = "text"

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 6
myst_url_schemes = {"http": None, "https": None, "source": None, "rust": None}

html_theme = "furo"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_favicon = "static/favicon.svg"
html_css_files = ["mathematics.css", "site.css"]
html_js_files = ["search_of_files.js", "sidebar.js"]
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
# Of `Reference`, whose constructors share their arguments.
napoleon_custom_sections = [("Arguments of all of them", "params_style")]
python_maximum_signature_line_length = 90
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
maximum_signature_line_length = 90
