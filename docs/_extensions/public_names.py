"""Warns of public names that the reference leaves out; the build fails on warnings."""

from __future__ import annotations

import inspect

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

import dryfric_control
from dryfric_control import presets

logger = logging.getLogger(__name__)


def public_names() -> list[str]:
    """Every name a user may rely on, those of `presets` with their module."""
    names = [name for name in dryfric_control.__all__ if name != "presets"]
    ready = inspect.getmembers(presets, inspect.isfunction)
    names += [
        f"presets.{name}"
        for name, item in ready
        if item.__module__ == presets.__name__ and not name.startswith("_")
    ]
    return [f"dryfric_control.{name}" for name in names]


def check(app: Sphinx, env: BuildEnvironment) -> None:
    described = env.get_domain("py").objects
    for name in public_names():
        if name not in described:
            logger.warning("public name %s is missing in reference.rst", name)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("env-check-consistency", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
