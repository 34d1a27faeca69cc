"""Sphinx's configuration of the site."""

from typing import Any

from docs.website.api import document_comments, process
from foundation.version import __version__

project = "DroneCATS"
author = copyright = "The DroneCATS authors"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary"]
root_doc = "index"

myst_heading_anchors = 4  # headings down to level 4 get the same anchors as on GitHub
suppress_warnings = ["myst.header"]  # pages of GitHub may start with a heading of any level

smartquotes = False  # smart quotes turn the -- of an option into one dash
highlight_language = "none"
default_role = "code"  # `name` in docstrings
autodoc_default_options = {"members": True, "member-order": "bysource"}
autoclass_content = "both"
autodoc_inherit_docstrings = False
autodoc_preserve_defaults = True
autosummary_generate = False  # the members of a module are on its page, without pages of their own
toc_object_entries = False  # entries for members double the build time, and each page has a table of members
autodoc_typehints_format = "short"
add_module_names = False
python_maximum_signature_line_length = 80

html_theme = "furo"
html_title = f"DroneCATS {__version__}"
html_static_path = ["style"]
html_css_files = ["site.css"]
html_copy_source = False
html_use_index = html_domain_indices = False  # the search has the same entries
html_show_sphinx = False
pygments_style, pygments_dark_style = "friendly", "monokai"


def setup(app: Any) -> None:
    """Register the conversion of docstrings and comments for Sphinx."""
    document_comments()
    app.connect("autodoc-process-docstring", process)
