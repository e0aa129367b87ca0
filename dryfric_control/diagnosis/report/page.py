"""The diagnosis as HTML: a summary for notebooks, a page that stands alone."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from dryfric_control._version import __version__
from dryfric_control.diagnosis.evidence import Evidence
from dryfric_control.diagnosis.report import figures, wording
from dryfric_control.diagnosis.report.findings import (
    SMALL,
    Findings,
    change_text,
    parameter_texts,
    plain_number,
)
from dryfric_control.diagnosis.thresholds import MIN_EVIDENCE
from dryfric_control.drawing import control_plot
from dryfric_control.model.effects.naming import titles_of
from dryfric_control.store.axis_file import axis_text
from dryfric_control.text import length_text, percent, rotary_words, table, typeset_signs

# Size of a panel [in]: two stand side by side on a page, one fills a telephone.
_PANEL = (4.9, 3.7)
# Resolution of clouds of dots [1/in].
_DOTS = 200
_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("dryfric_control.diagnosis.report", "."),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def _svg(draw: Callable[..., None], *given: Any, **options: Any) -> str:
    """What draws in axes as a picture in base64, always the same, without touching open figures."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "dryfric-control", "font.size": 11.0}):
        figure = Figure(figsize=_PANEL, layout="constrained")
        axes = figure.subplots(1, 1)
        draw(*given, axes, **options)
        if axes.get_xscale() == "linear":  # more of them touch, with a sign and two decimals
            axes.locator_params(axis="x", nbins=6)
        control_plot(np.array([axes], dtype=object))
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", dpi=_DOTS, metadata={"Date": None})
    return base64.b64encode(buffer.getvalue()).decode("ascii")


@jinja2.pass_context
def _axis_words(context: Any, value: Any) -> str:
    """Text in the words of the axis, typeset; names are left as they are."""
    return typeset_signs(rotary_words(value, context["force"]))


_TEMPLATES.filters |= {
    "typeset": typeset_signs,
    "words": _axis_words,
    "titles": titles_of,
    "plain": plain_number,
    "length": length_text,
    "html_table": lambda rows: Markup(table(rows, as_html=True)),
}
_TEMPLATES.globals |= {
    "br": Markup("<br>"),
    "say": wording,
    "parameter_texts": parameter_texts,
    "SMALL": SMALL,
    "MIN_EVIDENCE": MIN_EVIDENCE,
    "version": __version__,
    "figures": figures,
    "svg": _svg,
}


def html_summary(d: Findings) -> str:
    """Verdict, causes and gain as a fragment of HTML, without images and styles."""
    return _TEMPLATES.get_template("summary.html").render(d=d, force=d.axis.units[1])


def html_page(d: Findings) -> str:
    """The whole report as one HTML page that needs no network."""
    before, after = figures.sides(d)
    sides = figures.shown_sides(before, after)
    medians = ", ".join(f"{_median(side)} {name}" for side, _, name in sides)
    rms = ", ".join(f"{_force(side)} {name}" for side, _, name in sides)
    return _TEMPLATES.get_template("page.html").render(
        d=d,
        force=d.axis.units[1],
        before=before,
        after=after,
        medians=medians,
        rms=rms,
        references=[(name, f"{gain:+z.0f}") for name, gain in d.references.items()],
        evidence=_evidence_rows(d, before, after),
        acting=_acting_rows(d),
        toml=axis_text(d.extended),
    )


def _force(side: Evidence) -> str:
    """Force residual."""
    return f"{side.force_rms:.3g} {side.axis.units[1]}"


def _median(side: Evidence) -> str:
    """Median error of the free runs."""
    return length_text(float(np.median(side.error_by_window)), side.axis.units[0])


def _evidence_rows(d: Findings, before: Evidence, after: Evidence | None) -> list[tuple[str, ...]]:
    length, force = before.axis.units
    sides = figures.shown_sides(before, after)
    rows: dict[str, Callable[[Evidence], str]] = {
        rotary_words("force residual, RMS", force): _force,
        "free runs, RMS error": lambda side: length_text(side.position_rms, length),
        "free runs, median error": _median,
        "stick/slip mismatch *": lambda side: percent(side.stick_slip_mismatch),
    }
    head = (wording.shown_record(d) or "whole record", *(name for *_, name in sides))
    table = [head]
    for name, text in rows.items():
        table.append((name, *(text(side) for side, *_ in sides)))
    return table


def _acting_rows(d: Findings) -> list[tuple[str, ...]]:
    """Values that act in each direction, all effects included; beside those found, if any."""
    length, force = d.axis.units
    believed = d.axis.effective()
    found = d.extended.effective()
    head = ("friction, effects included", "nominal", "with the causes", "change")
    cells: list[tuple[str, ...]] = [head]

    def row(name: str, before: float, after: float, unit: str) -> None:
        suffix = "" if unit == "1" else f" {unit}"
        differs = abs(after - before) > 1e-9 * abs(before)
        change = change_text("amount", before, after) if differs else "none"
        cells.append((name, f"{before:.4g}{suffix}", f"{after:.4g}{suffix}", change))

    row(rotary_words("mass", force), believed.mass, found.mass, d.axis.unit("kg"))
    for sign, way in wording.WAYS:
        before, after = (wording.viscous_coefficient(axis, sign) for axis in (believed, found))
        row(f"viscous friction {way}", before, after, f"{force} s/{length}")
    table = wording.level_table(d)
    places = range(3) if wording.level_varies(table, in_place=True) else (1,)
    for _, way in wording.WAYS:
        for i in places:
            where = f" at x = {table['x'][i]:.3g} {length}" if len(places) > 1 else ""
            before, after = (table[side][way][i] for side in ("believed", "found"))
            row(f"Coulomb level {way}{where}", before, after, force)
    if (one := believed.stribeck) and (other := found.stribeck):
        row("Stribeck excess", one.excess, other.excess, "1")
        row("Stribeck velocity", one.speed, other.speed, f"{length}/s")
    return cells if d.causes else [line[:2] for line in cells]
