"""The documentation site: ``sphinx-build -W docs site``. Nothing is fetched, neither here nor by who reads it."""

import sys
from pathlib import Path

import jaxball

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
(HERE / "made" / "site").mkdir(parents=True, exist_ok=True)  # which Sphinx looks for before anything is made

project = "jaxball"
copyright = "the authors of jaxball"
version = release = jaxball.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "extensions.commands",
    "extensions.figures",
    "extensions.fonts",
    "extensions.gallery",
    "extensions.interface",
    "extensions.links",
    "extensions.mathematics",
    "extensions.notebooks",
]
exclude_patterns = ["figures", "made", "extensions"]
nitpicky = True  # what refers to nothing is a warning, and with -W an error

myst_enable_extensions = ["dollarmath", "attrs_block", "colon_fence"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

autodoc_member_order = "bysource"
python_use_unqualified_type_names = True
add_module_names = False
toc_object_entries_show_parents = "hide"
maximum_signature_line_length = 100

html_theme = "furo"
html_title = "jaxball"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["made/site"]
html_copy_source = False
html_show_search_summary = False  # which fetches pages, and cannot where they are opened as files
SANS_SERIF = '-apple-system, BlinkMacSystemFont, "Segoe UI", Helvetica, Arial, sans-serif'
MONOSPACE = '"SFMono-Regular", Menlo, Consolas, Monaco, "Liberation Mono", "Lucida Console", monospace'
html_theme_options = {
    "source_repository": "",
    "navigation_with_keys": True,
    "light_css_variables": {"font-stack": f"signs, {SANS_SERIF}", "font-stack--monospace": f"signs, {MONOSPACE}"},
}
