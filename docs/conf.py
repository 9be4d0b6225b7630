"""The HTML site: all Markdown pages of the project, and an API reference made from docstrings.

The folder of sources is the project's root, so that links work alike here and where the repository is read.
"""

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx

from trihedral.version import VERSION

ROOT = Path(__file__).resolve().parents[1]

project = "trihedral"
author = "the trihedral authors"
copyright = "2026, the trihedral authors"
version = release = VERSION
language = "en"

extensions = [
    "myst_parser",
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
]
include_patterns = ["*.md", "docs/*.md", "docs/method/*.md", "docs/api/*.rst", "benchmarks/results/*.md"]
root_doc = "docs/index"

html_theme = "furo"
html_title = f"trihedral {VERSION}"
html_show_sourcelink = False

# Every page that refers to something of ours must find it; NumPy's and others' pages are not to be had offline.
nitpicky = True
# Type variables and private classes have no entry of their own.
nitpick_ignore_regex = [("py:.*", r"(?!trihedral\.).*"), ("py:.*", r"trihedral\.(.*\.)?(_\w+|[A-Z])")]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

apidoc_modules = [
    {
        "path": str(ROOT / "src/trihedral"),
        "destination": "docs/api",
        "max_depth": 1,
        "separate_modules": False,
        "module_first": True,
        "exclude_patterns": [str(ROOT / "src/trihedral/__main__.py")],
        "automodule_options": {"members", "show-inheritance", "undoc-members"},
    }
]
autodoc_default_options = {"ignore-module-all": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
# Docstrings put names into single backquotes, as NumPy's do.
default_role = "code"


def setup(app: Sphinx) -> None:
    """Write equations as MathML, which browsers show without a script and without the network."""
    app.add_html_math_renderer("mathml", (_inline, None), (_display, None))
    app.connect("autodoc-process-docstring", _plurals)
    app.connect("doctree-read", _exactly)


html_math_renderer = "mathml"


def _plurals(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Let a letter follow a name in backquotes, as in `Trial`s."""
    lines[:] = [re.sub(r"(`[^`]+`)(?=[A-Za-z])", r"\1\\ ", line) for line in lines]


def _exactly(app: Sphinx, doctree: nodes.document) -> None:
    """Look a type up by the name that it has, not by any attribute that ends alike: `bytes` is Python's."""
    for reference in doctree.findall(pending_xref):
        reference.attributes.pop("refspecific", None)


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def _display(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>\n')
    raise nodes.SkipNode
