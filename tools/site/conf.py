"""Settings of the site: Sphinx reads the Markdown pages unchanged; neither the build nor the pages fetch anything."""

import re
from pathlib import Path
from typing import Any

import sphinx.search
from pygments.lexers.special import TextLexer
from sphinx.errors import ExtensionError
from sphinx.search.en import SearchEnglish

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

DROPS_NUMBERS = r" || queryTerm.match(/^\d+$/)"
"""Condition by which the script of the search ignores the numbers in a query."""


class SearchWithNumbers(SearchEnglish):
    """The search in English, which also finds numbers, and the parts of names such as ``sps1000`` and ``sd_code``."""

    def split(self, input: str) -> list[str]:
        """Return the words of a text, followed by the parts of names; 1,000 is the number 1000."""
        text = re.sub(r"(?<=\d),(?=\d{3}\b)", "", input)
        words = super().split(text)
        parts = (part for word in words for part in re.findall(r"[^\W\d_]{2,}|\d+", word) if part != word)
        return [*words, *parts]

    def word_filter(self, word: str) -> bool:
        """Return whether a word belongs in the index."""
        return word not in self.stopwords


def _keep_numbers(app: Any, error: Exception | None) -> None:
    """Let the script of the search look for numbers, which Sphinx leaves out of every query."""
    script = Path(app.outdir) / "_static/searchtools.js"
    if error is not None or not script.is_file():
        return
    text = script.read_text(encoding="utf-8")
    if text.count(DROPS_NUMBERS) != 1:
        raise ExtensionError(f"searchtools.js of Sphinx {sphinx.__version__} drops numbers in another way")
    script.write_text(text.replace(DROPS_NUMBERS, ""), encoding="utf-8")


def setup(app: Any) -> None:
    """Show CSV blocks without syntax colours, and let the search find numbers and parts of names."""
    app.add_lexer("csv", TextLexer)
    sphinx.search.languages["en"] = SearchWithNumbers
    app.connect("build-finished", _keep_numbers)
