"""Settings of the site: Sphinx reads the Markdown pages unchanged; neither the build nor the pages fetch anything."""

from typing import Any

from pygments.lexers.special import TextLexer

project = "saf_gen"
author = "the authors of saf_gen"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
autodoc_typehints = "none"
source_suffix = {".md": "markdown"}
root_doc = "README"
myst_heading_anchors = 4
highlight_language = "none"
html_theme = "furo"
html_title = "saf_gen"
html_copy_source = False
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["site.css"]


def setup(app: Any) -> None:
    """Show CSV blocks without syntax colours."""
    app.add_lexer("csv", TextLexer)
