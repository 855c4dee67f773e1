"""Sphinx configuration. ``SKSURROGATE_GALLERY=1`` runs the examples; without it they are shown unrun."""

import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_scripts")]

from docutils import nodes  # noqa: E402
from docutils.utils.math import latex2mathml  # noqa: E402
from reference_page import write_reference  # noqa: E402
from sphinx_gallery import gen_rst  # noqa: E402

import sksurrogate  # noqa: E402

write_reference(HERE / "generated")

project = "sksurrogate"
author = "the sksurrogate developers"
copyright = author
version = release = sksurrogate.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "myst_parser",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "auto_examples/*.ipynb", "auto_examples/*.py", "auto_examples/*.json", "_scripts"]
suppress_warnings = ["config.cache"]
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!sksurrogate\.).*"),  # other projects' inventories are not fetched: builds are offline
    ("py:.*", r".*\._.*"),  # private places
    ("py:data", r".*"),
]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's sections say it, with shapes
numpydoc_show_class_members = False
templates_path = ["_templates"]

html_theme = "pydata_sphinx_theme"
html_title = "sksurrogate"
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 4,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"*": [], "*/*": ["sidebar-nav-bs"]}
html_show_sourcelink = False
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["wide_tables.css"]

run_block = gen_rst._exec_and_get_memory


def run_block_or_stop(compiler, *, script_vars, **more):
    """An example that lacks its data says so and leaves with ``SystemExit(0)``: that ends the example, not the build."""
    try:
        return run_block(compiler, script_vars=script_vars, **more)
    except SystemExit as stop:
        if stop.code:
            raise RuntimeError(f"the example left with status {stop.code}") from stop
        script_vars["execute_script"] = False
        return False, 0.0


gen_rst._exec_and_get_memory = run_block_or_stop
run_gallery = os.environ.get("SKSURROGATE_GALLERY", "0") == "1"
sphinx_gallery_conf = {
    "examples_dirs": [str(HERE.parent / "examples")],
    "gallery_dirs": ["auto_examples"],
    "filename_pattern": r"/plot_",
    "plot_gallery": "True" if run_gallery else "False",
    "abort_on_example_error": False,
    "only_warn_on_example_error": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "download_all_examples": False,
    "min_reported_time": 1000,
    "write_computation_times": False,
    "reset_argv": lambda gallery_conf, script_vars: [],
}


def skip_requests(app, what, name, obj, skip, options):
    """scikit-learn's generated ``set_*_request`` point into its own glossary."""
    return True if name.startswith("set_") and name.endswith("_request") else skip


def keep_underscores(app, what, name, obj, options, lines):
    """``coef_`` in a docstring is a name, not a link to "coef"."""
    in_example = False
    for i, line in enumerate(lines):
        in_example = line.strip().startswith(">>>") or (in_example and bool(line.strip()))
        if not in_example:
            parts = re.split(r"(`+[^`]*`+_*)", line)
            parts[::2] = [re.sub(r"(?<![\\\w])(\w+)_(?!\w)", r"\1\\_", part) for part in parts[::2]]
            lines[i] = "".join(parts)


def write_math(translator, node):
    """MathML in the page: no script from elsewhere, readable offline."""
    block = isinstance(node, nodes.math_block)
    math = latex2mathml.tex2mathml(node.astext(), as_block=block)
    translator.body.append(f'<div class="math">{math}</div>' if block else math)
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("mathml", inline_renderers=(write_math, None), block_renderers=(write_math, None))
    app.connect("autodoc-process-docstring", keep_underscores, priority=900)
    app.connect("autodoc-skip-member", skip_requests)
