"""The diagnosis as HTML: a summary for notebooks, a page that stands alone."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Sequence
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from dryfric_control._version import __version__
from dryfric_control.diagnosis.evidence import Evidence
from dryfric_control.diagnosis.report import figures, wording
from dryfric_control.diagnosis.report.findings import (
    SMALL,
    Cause,
    Findings,
    change_text,
    parameter_texts,
    plain,
    titles_of,
)
from dryfric_control.drawing import control_plot
from dryfric_control.store.axis_file import axis_text
from dryfric_control.text import length_text, table, typeset

# What each verdict means, for whoever sees the word for the first time.
MEANING = {
    "nothing to find": "The simulation differs from the record by no more than noise does.",
    "explained": "With the causes below, free runs err by no more than noise makes them err.",
    "partly explained": "The causes below are real, but structure is left that none explains.",
    "unexplained": "The simulation is wrong, and no cause in the catalogue explains how.",
}

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("dryfric_control.diagnosis.report", "."),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters["typeset"] = lambda value: typeset(str(value))
_TEMPLATES.globals["br"] = Markup("<br>")


def html_summary(d: Findings) -> str:
    """Verdict, causes and gain as a fragment of HTML, without images and styles."""
    return _TEMPLATES.get_template("summary.html").render(_found(d))


def html_page(d: Findings) -> str:
    """The whole report as one HTML page that needs no network."""
    before, after = figures.sides(d)
    r = d.record
    return _TEMPLATES.get_template("page.html").render(
        _found(d),
        axis=d.axis.name,
        record=r.name or "record",
        pictures=_pictures(d, before, after),
        evidence=Markup(table(_evidence_rows(before, after), as_html=True)),
        acting=Markup(table(_acting_rows(d), as_html=True)),
        extended_by_effects=bool(d.extended.effects),
        nominal=d.axis.describe(),
        extended=d.extended.describe(),
        dt=f"{r.dt:.6g}",
        quantum=f", encoder_quantum={r.quantum:.4g}" if r.quantum else "",
        toml=axis_text(d.extended),
        provenance=_provenance(d),
    )


def _found(d: Findings) -> dict[str, Any]:
    """What the summary shows, as text."""
    left = d.unexplained
    words = f"Unexplained: {100.0 * left.fraction:.3g} % of the structured error"
    return {
        "verdict": wording.headline(d),
        "meaning": MEANING.get(d.verdict, ""),
        "causes": [_cause(d, cause) for cause in d.main_causes],
        "corrections": [_cause(d, cause) for cause in d.small_corrections],
        "small": f"{100.0 * SMALL:g}",
        "gain": _gain(d),
        "unexplained": ", ".join([words, "; ".join(left.where)]).removesuffix(", ") + "."
        if left.significant
        else "",
        "further": wording.further_lines(d),
        "messages": d.messages,
        "experiment": "" if d.next_experiment is None else d.next_experiment.summary(),
    }


def _cause(d: Findings, cause: Cause) -> dict[str, Any]:
    values = (cause.held_out_gain, *cause.interval)
    times, low, high = (plain(wording.times_smaller(value)) for value in values)
    return {
        "title": cause.title,
        "effect": cause.effect,
        "parameters": parameter_texts(cause, d.axis),
        "meaning": wording.meaning(d, cause),
        "reduction": f"{times} ({low} to {high})",
        "alternatives": ", ".join(map(titles_of, cause.alternatives)) or "none",
        "explanation": cause.explanation,
        "experiment": cause.experiment,
    }


def _gain(d: Findings) -> str:
    g = d.gain
    before, after, floor = (length_text(v, g.unit) for v in (g.before, g.after, g.floor))
    runs = "Free runs, each from its most likely start"
    if not d.causes:
        return f"{runs}: RMS error {before}, noise floor {floor}."
    return (
        f"{runs}, on data that neither search nor fit has seen: RMS error {before} with the "
        f"nominal axis, {after} with the causes, noise floor {floor}; error reduction (factor) "
        f"{plain(g.ratio)} (90 %: {plain(g.interval[0])} to {plain(g.interval[1])})."
    )


def _provenance(d: Findings) -> str:
    r = d.record
    unit = d.axis.units[0]
    quantum = f", encoder quantum {length_text(r.quantum, unit)}" if r.quantum else ""
    return (
        f"{len(r)} samples in {r.duration:.4g} s, range {length_text(r.range, unit)}{quantum}; "
        f"free runs of {d.window:.3g} s; dryfric-control {__version__}."
    )


def _png(size: tuple[float, float], columns: int, draw: Callable[[Sequence[Any]], None]) -> bytes:
    """A picture of some panels side by side, without touching open figures."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False, sharey=columns > 2)[0]
    draw(axes)
    control_plot(axes)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    return buffer.getvalue()


def _picture(data: bytes, alt: str, caption: str) -> dict[str, str]:
    return {"png": base64.b64encode(data).decode("ascii"), "alt": alt, "caption": caption}


def _medians(before: Evidence, after: Evidence | None) -> str:
    unit = before.axis.units[0]
    words = f"median {length_text(float(np.median(before.error_by_window)), unit)} nominal"
    if after is not None:
        found = length_text(float(np.median(after.error_by_window)), unit)
        words += f", {found} with the causes"
    return words


def _pictures(d: Findings, before: Evidence, after: Evidence | None) -> list[dict[str, str]]:
    def residuals(axes: Sequence[Any]) -> None:
        for i, by in enumerate(figures.AGAINST):
            figures.draw_residual(before, after, by, axes[i], legend=i == 0)

    force = before.axis.units[1]
    rms = f"RMS {before.force_rms:.3g} {force} nominal"
    if after is not None:
        rms += f", {after.force_rms:.3g} {force} with the causes"
    pictures = [
        _picture(
            _png((9.0, 2.8), 1, lambda axes: figures.draw_errors(d, before, after, axes[0])),
            f"RMS error of every free run over time, {_medians(before, after)}.",
            "Error of free runs, each started from its most likely state. Grey: what the data "
            "was used for; white was used to fit.",
        ),
        _picture(
            _png((9.0, 2.8), 1, lambda axes: figures.draw_position(d, before, after, axes[0])),
            "Measured position and free runs over time, where the errors are among the largest.",
            "Close-up of a stretch where the errors of the free runs are among the largest.",
        ),
        _picture(
            _png((9.0, 2.8), len(figures.AGAINST), residuals),
            f"Force residual against velocity, position, time and time since reversal; {rms}.",
            "Force that the model would need beside its drive to move as measured. Grey dots: "
            "sliding samples of the nominal axis; lines: medians, over position one for "
            "each direction.",
        ),
    ]
    table = wording.level_table(d)
    if wording.level_varies(table):
        unit = d.axis.units
        pictures.append(
            _picture(
                _png((9.0, 3.2), 1, lambda axes: figures.draw_levels(d, axes[0])),
                "Coulomb level over position; nominal: "
                f"{wording.level_text(table, 'believed', unit)}; with the causes: "
                f"{wording.level_text(table, 'found', unit)}.",
                "Coulomb level, without Stribeck peak and load, with every effect that changes it, "
                "over the range that the record visited. Marks show the direction: > forwards (x "
                "grows), < backwards.",
            )
        )
    times = figures.falls(d)
    if figures.any_bar(d):
        best = next(iter(times))
        pictures.append(
            _picture(
                _png((9.0, 4.2), 1, lambda axes: figures.draw_candidates(d, axes[0])),
                "Bars: error reduction (factor) of each candidate alone; the "
                f"longest: {titles_of(best)}, {plain(times[best])}.",
                "Error reduction (factor) of each candidate as the only cause, on free runs that "
                "the fit did not see, against an axis that only gets other values for mass, "
                "viscous friction and Coulomb level (1: no better, and no bar for what is no "
                "better or worse). A cause that is useful only in combination need not stand "
                "out here.",
            )
        )
    elif times:
        pictures.append({"png": "", "alt": "", "caption": figures.NO_BAR})
    pictures.append(
        _picture(
            _png((9.0, 2.8), 1, lambda axes: figures.draw_autocorrelation(before, after, axes[0])),
            "Autocorrelation of the force residual over the lag, with the band of white noise.",
            "A residual that is noise stays in the band, but for the shortest lags, which the "
            "smoothing correlates.",
        )
    )
    return pictures


def _evidence_rows(before: Evidence, after: Evidence | None) -> list[tuple[str, ...]]:
    length, force = before.axis.units
    sides = [before] if after is None else [before, after]
    return [
        ("whole record", "nominal", "with the causes")[: len(sides) + 1],
        ("force residual, RMS", *(f"{s.force_rms:.3g} {force}" for s in sides)),
        ("free runs, RMS error", *(length_text(s.position_rms, length) for s in sides)),
        (
            "free runs, median error",
            *(length_text(float(np.median(s.error_by_window)), length) for s in sides),
        ),
        ("stick/slip mismatch *", *(f"{100.0 * s.disagreement:.2g} %" for s in sides)),
    ]


def _acting_rows(d: Findings) -> list[tuple[str, ...]]:
    """Values that act in each direction, all effects included."""
    length, force = d.axis.units
    believed, found = d.axis.effective(), d.extended.effective()
    rows: list[tuple[str, float, float, str]] = [
        ("mass", believed.mass, found.mass, d.axis.unit("kg"))
    ]
    for sign, way in wording.WAYS:
        before, after = (wording.viscous_coefficient(axis, sign) for axis in (believed, found))
        rows.append((f"viscous friction {way}", before, after, f"{force} s/{length}"))
    table = wording.level_table(d)
    places = range(3) if wording.level_moves(table) else (1,)
    for _, way in wording.WAYS:
        for i in places:
            where = f" at x = {table['x'][i]:.3g} {length}" if len(places) > 1 else ""
            before, after = (table[side][way][i] for side in ("believed", "found"))
            rows.append((f"Coulomb level {way}{where}", before, after, force))
    if believed.stribeck and found.stribeck:
        peaks = believed.stribeck, found.stribeck
        rows.append(("Stribeck excess", peaks[0].excess, peaks[1].excess, "1"))
        rows.append(("Stribeck speed", peaks[0].speed, peaks[1].speed, f"{length}/s"))

    cells: list[tuple[str, ...]] = [
        ("friction effects included", "nominal", "with the causes", "change")
    ]
    for name, before, after, unit in rows:
        suffix = "" if unit == "1" else f" {unit}"
        differs = abs(after - before) > 1e-9 * abs(before)
        change = change_text("amount", before, after) if differs else "none"
        cells.append((name, f"{before:.4g}{suffix}", f"{after:.4g}{suffix}", change))
    return cells
