"""Sphinx configuration. Examples are shown with stored outputs (``_scripts/gallery.py``)."""

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "_scripts")]

from docutils import nodes  # noqa: E402
from docutils.utils.math import latex2mathml  # noqa: E402
from gallery import use_store  # noqa: E402
from numpydoc import xref  # noqa: E402
from reference_page import FACES, aliases, public_names, write_reference  # noqa: E402

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
exclude_patterns = [
    "_build",
    "auto_examples/**.ipynb",
    "auto_examples/**.py",
    "auto_examples/**.json",
    "_scripts",
    "_gallery",
]
suppress_warnings = ["config.cache"]
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!sksurrogate\.).*"),  # other projects' inventories are not fetched: builds are offline
    ("py:.*", r".*\._.*"),  # private places
    ("py:data", r".*"),
    (
        "py:obj",
        r"sksurrogate\..*\.(get_params|set_params|set_output|fit_transform|fit_predict|score|transform|count|index)",
    ),  # scikit-learn's
]

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's sections say it, with shapes
numpydoc_show_class_members = False
numpydoc_xref_param_type = True  # the types of parameters and attributes are links ...
numpydoc_xref_ignore = "all"  # ... where they are this package's
numpydoc_xref_aliases = aliases()
xref.DEFAULT_LINKS.clear()  # terms in the inventories of numpy and python, which are not fetched
add_module_names = False
toc_object_entries_show_parents = "hide"
templates_path = ["_templates"]

html_theme = "pydata_sphinx_theme"
html_title = "sksurrogate"
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"**": ["whole-nav"]}
html_show_sourcelink = False
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]

sphinx_gallery_conf = {
    "examples_dirs": [str(HERE.parent / "examples")],
    "gallery_dirs": ["auto_examples"],
    "filename_pattern": r"/(plot|tutorial)_",
    "plot_gallery": "True",
    "abort_on_example_error": False,
    "only_warn_on_example_error": False,
    "show_memory": False,
    "default_thumb_file": str(HERE / "readme.png"),
    "capture_repr": (),  # examples print what they show
    "subsection_order": [
        f"../examples/{part}" for part in ("tutorials", "diagnosis", "hybrid_and_control", "fits", "paper")
    ],
    "show_signature": False,
    "remove_config_comments": True,
    "download_all_examples": False,
    "min_reported_time": 1000,
    "write_computation_times": False,
    "reset_argv": lambda gallery_conf, script_vars: [],
}


def skip_requests(app, what, name, obj, skip, options):
    """scikit-learn's ``set_*_request`` and ``get_metadata_routing`` point into its own glossary."""
    routing = name == "get_metadata_routing" or (name.startswith("set_") and name.endswith("_request"))
    return True if routing or str(getattr(obj, "__module__", "")).startswith("sklearn.") else skip


def keep_underscores(app, what, name, obj, options, lines):
    """``coef_`` in a docstring is a name, not a link to "coef"."""
    in_example = False
    for i, line in enumerate(lines):
        in_example = line.strip().startswith(">>>") or (in_example and bool(line.strip()))
        if not in_example:
            parts = re.split(r"(`+[^`]*`+_*)", line)
            parts[::2] = [re.sub(r"(?<![\\\w])(\w+)_(?!\w)", r"\1\\_", part) for part in parts[::2]]
            parts[::2] = [re.sub(r"(?<=[ (])\*(?=\w+\))", r"\\*", part) for part in parts[::2]]  # (n_states, *s)
            lines[i] = "".join(parts)


#: Public name -> its page; names that stand in several modules are left out.
PAGES: dict[str, str] = {}
for face in FACES:
    for name in public_names(face):
        PAGES[name] = "" if name in PAGES else f"generated/sksurrogate.{face}.{name}"


def link_names(app, doctree, docname):
    """``GapDiagnoser`` or ``GapDiagnoser(...)`` in a guide is a link to its page in the reference."""
    if docname.startswith(("generated/", "auto_examples/")):
        return
    for literal in list(doctree.findall(nodes.literal)):
        name = re.match(r"\w*", literal.astext()).group()
        ends = literal.astext()[len(name) :]
        inside = isinstance(literal.parent, (nodes.reference, nodes.title))
        if not inside and PAGES.get(name) and (not ends or (ends[0] == "(" and ends[-1] == ")")):
            target = app.builder.get_relative_uri(docname, PAGES[name])
            literal.replace_self(nodes.reference("", "", literal.deepcopy(), internal=True, refuri=target))


def write_math(translator, node):
    """MathML in the page: no script from elsewhere, readable offline."""
    block = isinstance(node, nodes.math_block)
    math = latex2mathml.tex2mathml(node.astext(), as_block=block)
    translator.body.append(f'<div class="math">{math}</div>' if block else math)
    raise nodes.SkipNode


def setup(app):
    use_store(app)
    app.add_html_math_renderer("mathml", inline_renderers=(write_math, None), block_renderers=(write_math, None))
    app.connect("autodoc-process-docstring", keep_underscores, priority=900)
    app.connect("autodoc-skip-member", skip_requests)
    app.connect("doctree-resolved", link_names)
