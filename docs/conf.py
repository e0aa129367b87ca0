"""Settings of the documentation site: ``sphinx-build docs docs/_build/html``."""

import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_extensions"))

import dryfric_control  # noqa: E402

project = "dryfric-control"
author = "The dryfric-control developers"
copyright = author
version = release = dryfric_control.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_nb",
    "mathml",
    "plain_pages",
    "effects_catalogue",
    "public_names",
]
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]
default_role = "py:obj"
templates_path = ["_templates"]

# The site is read where there is no network: no script, font or inventory of
# another host.  Equations are MathML, which browsers draw themselves; the font
# for them is copied from the package ziamath.
html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"dryfric-control {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
nb_ipywidgets_js = {}

autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

myst_enable_extensions = ["amsmath", "dollarmath"]
myst_heading_anchors = 3

# "cache" runs a notebook once and again only when it has changed.  CI says
# "off": there the tests have just run every notebook from a clean kernel.
nb_execution_mode = "cache"
nb_execution_timeout = 300
nb_execution_show_tb = True
nb_merge_streams = True
# Figures belong into the page, whatever backend the shell is set to; and the
# page has no use for a live progress bar.
os.environ.pop("MPLBACKEND", None)
os.environ["PYTHONWARNINGS"] = "ignore:IProgress not found"


def copy_notebooks() -> None:
    """Notebooks live beside the documentation; Sphinx reads inside it only."""
    target = HERE / "notebooks"
    target.mkdir(exist_ok=True)
    found = {path.name: path for path in sorted((HERE.parent / "notebooks").glob("*.ipynb"))}
    for stale in target.glob("*.ipynb"):
        if stale.name not in found:
            stale.unlink()
    for name, path in found.items():
        copy = target / name
        if not copy.exists() or copy.read_bytes() != path.read_bytes():
            shutil.copyfile(path, copy)


copy_notebooks()
