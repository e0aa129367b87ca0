"""Pages are plain Markdown, as a code host shows them; what the site needs beyond is added here.

A page of links is a branch of the site's tree: its own links, in their order.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

#: Pages of links.
BRANCHES = ("index", "howto/index", "benchmarks", "notebooks")


def links(text: str) -> list[str]:
    """Pages that a page links, each once."""
    found = re.findall(r"\]\(([\w/]+)\.(?:md|rst|ipynb)\)", text)
    return list(dict.fromkeys(found))


def complete(app: Sphinx, page: str, content: list[str]) -> None:
    """Add what only the site has."""
    if page == "changelog":
        content[0] = Path(app.srcdir, "..", "CHANGELOG.md").read_text(encoding="utf-8")
    # The notebooks are copied into the sources of the site.
    text = content[0] = content[0].replace("](../notebooks/", "](notebooks/")
    if page in BRANCHES:
        names = "\n".join(links(text))
        content[0] = f"{text}\n\n```{{toctree}}\n:hidden:\n:maxdepth: 2\n\n{names}\n```\n"


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", complete)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
