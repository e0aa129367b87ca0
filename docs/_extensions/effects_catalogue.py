"""Writes the page `effects.md` from the effect classes before every build.

A test keeps the stored one up to date.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from numpydoc.docscrape import NumpyDocString

from dryfric_control.model.effects import Effect
from dryfric_control.model.effects.effect import ACTIONS, REGISTRY

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = "effects.md"
#: What each action means, in the words of the page.
ACTS_ON = {
    "input": "replaces the drive force",
    "force": "a force on the mass",
    "friction": "adds to the friction level",
    "reading": "adds to the encoder reading",
    "axis": "changes a base parameter",
    "delay": "delays the drive force",
    "lag": "filters the drive force",
    "contact": "makes the contact elastic",
    "transmission": "splits the mass into motor and load",
    "memory": "adds a force, or friction, from states of its own",
}
HEAD = """\
# The effects

Effects that an axis may have in addition to mass, viscous friction, Coulomb level and Stribeck
peak. Each effect is one class, and this page is generated from the classes that `simulate`
integrates, `fit` fits and `diagnose` tries. [Add an effect of your own](howto/add_effect.md).

```python
import dryfric_control as dfc

axis = dfc.FrictionAxis(
    mass=2.0,
    viscous=15.0,
    coulomb=8.0,
    effects=(dfc.effects.Spring(stiffness=200.0), dfc.effects.BiasForce(force=1.5)),
)
```

In the equations $x$ is the position, $v$ the velocity, $u$ the drive force, $e$ the sum of the
force effects, $w = u + e$ the force on the mass without friction, $F_c$ the Coulomb level (a
magnitude, for each direction) and $t$ the time; an arrow shows what replaces what, and words are
parameters. Units are those of an axis in metres and newtons; a rotary axis has radians and newton
metres.

Effects can be combined freely. Forces add up; of the friction, shares of the level (by position,
time or warm-up) multiply, and act on the level of each direction. An axis has at most one delay,
one lag, one `presliding`, and one of `backlash` or `compliance`; of the others it may have several.
The second of a kind has the name `cogging_2`, as in `fit(..., free=("cogging_2.amplitude",))`;
`axis.named_effects()` lists them.

## Signature of a missing effect

Each panel compares a simulated record with an axis that is correct except for the effect. It shows
the force residual (drive force that the nominal axis would need to move in the same way, minus the
actual drive force), forwards in blue and backwards in orange, over the quantity on which it depends
most clearly. Where a force does not show the effect, the panel has what does: the position
(presliding), the breakaway force (dwell time), the velocity (backlash, encoder on the load). The
section on each effect shows the same, next to the residual over velocity.
`d.plot()` draws such panels for your own record. `python docs/make_effects.py` draws these.

![Force residual of each missing effect, over what shows it best](images/effects.png)

Some look alike, such as `input_gain` and `load_dependence`; a diagnosis then names one of them
and the other as an [alternative](diagnosis.md).

## All effects

"""


def range_text(bounds: tuple[float, float]) -> str:
    """Allowed values in words."""
    low, high = bounds
    if math.isinf(low) and math.isinf(high):
        return "any"
    if math.isinf(high):
        return "0 or more" if low == 0.0 else "more than 0" if low < 1e-6 else f"{low:g} or more"
    if low == 1.0 - high:
        return "between 0 and 1"
    return f"{low:g} to {high:g}"


def rows(cls: type[Effect]) -> Iterator[str]:
    """Table of an effect's parameters."""
    yield "| parameter | unit | allowed | default | meaning |"
    yield "|---|---|---|---|---|"
    for name, data in cls.parameters().items():
        default = getattr(cls, name, None)
        shown = "" if default is None else f"{default:g}"
        unit, meaning = data["unit"].replace("^2", "²"), data["doc"].replace("|", "\\|")
        yield f"| `{name}` | {unit} | {range_text(data['bounds'])} | {shown} | {meaning} |"


def heading(cls: type[Effect]) -> str:
    """Title of an effect's section."""
    return f"{cls.title[0].upper()}{cls.title[1:]}"


def anchor(cls: type[Effect]) -> str:
    """Name by which a code host, and the site, reach a heading."""
    return re.sub(r"[^\w\- ]", "", heading(cls).lower()).replace(" ", "-")


def as_markdown(notes: list[str]) -> Iterator[str]:
    """Notes of a docstring, their equations as Markdown has them."""
    equation = False
    for line in notes:
        if line.startswith(".. math::"):
            equation = True
            yield "$$"
            line = line.removeprefix(".. math::")
        elif equation and not line.startswith(" "):
            equation = False
            yield "$$"
        yield line.strip() if equation else line
    if equation:
        yield "$$"


def section(cls: type[Effect]) -> Iterator[str]:
    """One effect."""
    doc = NumpyDocString(inspect.getdoc(cls) or "")
    yield f"## {heading(cls)}"
    yield ""
    name = f"dfc.effects.{cls.__name__}"
    yield f"`{cls.slug}`, `{name}`: {ACTS_ON[cls.action]}."
    yield ""
    yield cls.explanation
    yield ""
    yield f"![Force residual of a model without it: {cls.title}](images/effects/{cls.slug}.png)"
    yield ""
    yield f"**To expose it:** {cls.experiment}"
    yield ""
    yield from rows(cls)
    yield ""
    yield from as_markdown(doc["Notes"])
    yield ""


def page() -> str:
    """The whole catalogue as Markdown."""
    missing = set(ACTIONS) - set(ACTS_ON)
    if missing:
        raise ValueError(f"say in ACTS_ON what {sorted(missing)} act on")
    lines = ["| effect | id | what it is |", "|---|---|---|"]
    own = [cls for cls in REGISTRY.values() if cls.__module__.startswith("dryfric_control.")]
    for cls in own:
        lines.append(f"| [{cls.title}](#{anchor(cls)}) | `{cls.slug}` | {ACTS_ON[cls.action]} |")
    lines.append("")
    for cls in own:
        lines += section(cls)
    return HEAD + "\n".join(lines)


def write_page(app: Sphinx) -> None:
    target, text = Path(app.srcdir, PAGE), page()
    if not target.exists() or target.read_text(encoding="utf-8") != text:
        target.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", write_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
