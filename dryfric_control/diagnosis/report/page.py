"""The diagnosis as HTML: a summary for notebooks, a page that stands alone."""

from __future__ import annotations

import base64
import html
import io
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dryfric_control._version import __version__
from dryfric_control.diagnosis.evidence import Evidence
from dryfric_control.diagnosis.report import candidate_bars, figures, wording
from dryfric_control.store.axis_file import axis_text
from dryfric_control.store.files import replacing
from dryfric_control.text import length_text

if TYPE_CHECKING:
    from dryfric_control.diagnosis.report.diagnosis import Cause, Diagnosis

# What each verdict means, for whoever sees the word for the first time.
MEANING = {
    "nothing to find": "The simulation differs from the record by no more than noise does.",
    "explained": "With the causes below, free runs err by no more than noise makes them err.",
    "partly explained": "The causes below are real, but structure is left that none explains.",
    "unexplained": "The simulation is wrong, and no cause in the catalogue explains how.",
}

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; line-height: 1.25; } h2 { font-size: 1.15rem; margin-top: 2rem; }
h3 { font-size: 1rem; margin-bottom: 0.2rem; }
.verdict { border-left: 0.4rem solid #0072b2; background: #f2f6f9; padding: 0.6rem 1rem; }
.verdict strong { font-size: 1.2rem; }
table { border-collapse: collapse; margin: 0.5rem 0; }
caption { text-align: left; color: #444; padding-bottom: 0.3rem; }
th, td { text-align: left; vertical-align: top; padding: 0.25rem 0.9rem 0.25rem 0;
         border-bottom: 1px solid #ccc; }
figure { margin: 1.2rem 0; } figure img { width: 100%; height: auto; }
figcaption { color: #444; font-size: 0.9rem; }
pre { background: #f5f5f5; padding: 0.7rem; overflow-x: auto; font-size: 0.85rem; }
.pair { display: flex; flex-wrap: wrap; gap: 1rem; } .pair > div { flex: 1 1 22rem; }
@media print { body { max-width: none; margin: 0; font-size: 11px; }
               figure, tr, h3 { break-inside: avoid; } pre { white-space: pre-wrap; } }
"""


def _text(value: object) -> str:
    return html.escape(figures.typeset(str(value)))


def _number(value: float) -> str:
    return f"{value:.3g}"


def _row(cells: Iterable[str], tag: str = "td") -> str:
    return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in cells) + "</tr>"


def _headings(names: Iterable[str]) -> str:
    cells = "".join(f'<th scope="col">{_text(name)}</th>' for name in names)
    return f"<thead><tr>{cells}</tr></thead>"


def _lines(texts: Iterable[str]) -> str:
    return "<br>".join(map(_text, texts))


def _brings(cause: Cause) -> str:
    """What a cause brings in words: times by which the typical error falls."""
    values = (cause.held_out_gain, *cause.interval)
    times, low, high = (wording.plain(wording.times_smaller(value)) for value in values)
    return f"{times} times smaller ({low} to {high})"


def _rivals(cause: Cause) -> str:
    names = ", ".join(map(wording.title_of, cause.alternatives))
    return _text(names or "nothing: no other cause does as well")


def _causes_table(d: Diagnosis) -> str:
    """Causes, small corrections apart from them, and one footnote for both."""
    if not d.causes:
        return ""
    parts = []
    if d.main_causes:
        head = _headings(
            ("", "cause", "parameters", "typical error with it (90 %)", "could as well be")
        )
        rows = []
        for i, cause in enumerate(d.main_causes, start=1):
            name = f"{_text(cause.title)}<br><code>{_text(cause.effect)}</code>"
            numbers = _lines(wording.parameter_texts(cause, d.axis))
            means = wording.meaning(d, cause)
            numbers += f"<br><small>{_lines(means)}</small>" if means else ""
            rows.append(_row((str(i), name, numbers, _text(_brings(cause)), _rivals(cause))))
        caption = "<caption>Causes, in the order found.</caption>"
        parts.append(f"<table>{caption}{head}<tbody>{''.join(rows)}</tbody></table>")
    if d.small_corrections:
        words = (
            f"Each number moves by {100.0 * wording.SMALL:g} % or less: nothing new in the machine."
        )
        head = _headings(("", "believed -> found (change)", "typical error with it (90 %)"))
        body = "".join(
            _row(
                (
                    f"{_text(cause.title)}<br><code>{_text(cause.effect)}</code>",
                    _lines(wording.parameter_texts(cause, d.axis)),
                    _text(_brings(cause)),
                )
            )
            for cause in d.small_corrections
        )
        parts.append(f"<h3>Small corrections of believed numbers</h3><p>{_text(words)}</p>")
        parts.append(f"<table>{head}<tbody>{body}</tbody></table>")
    parts.append(f"<p><small>{_text(_FOOTNOTE)}</small></p>")
    return "".join(parts)


_FOOTNOTE = (
    "After +-: one standard error. It covers the random error of this record alone, not that of "
    "the model: what the model leaves out can move a number by more. Typical error: of free runs "
    "that the fit did not see, each counted together with the noise (geometric mean), with all "
    "causes, beside the same without this one."
)
_FREE_RUNS = "Free runs, each from its most likely start"


def _gain_sentence(d: Diagnosis) -> str:
    g = d.gain
    before, after, floor = (length_text(v, g.unit) for v in (g.before, g.after, g.floor))
    if not d.causes:
        return f"<p>{_text(f'{_FREE_RUNS}: {before} RMS error, {floor} is the noise floor.')}</p>"
    words = (
        f"{_FREE_RUNS}, on data that neither search nor fit has seen: {before} RMS error with the "
        f"axis as believed, {after} with the causes, {floor} is the noise floor; "
        f"{wording.plain(g.ratio)} times smaller (90 %: {wording.plain(g.interval[0])} to "
        f"{wording.plain(g.interval[1])})."
    )
    return f"<p>{_text(words)}</p>"


def _left(d: Diagnosis) -> str:
    parts = []
    if d.unexplained.significant:
        places = "; ".join(d.unexplained.where)
        words = f"Unexplained: {100.0 * d.unexplained.fraction:.3g} % of the structured error"
        parts.append(f"<p>{_text(words + (f', {places}' if places else ''))}.</p>")
    if d.messages:
        items = "".join(f"<li>{_text(message)}</li>" for message in d.messages)
        parts.append(f"<p>Beware:</p><ul>{items}</ul>")
    if d.next_experiment is not None:
        words = d.next_experiment.summary()
        parts.append(f"<p><strong>Next experiment:</strong> {_text(words)}</p>")
    return "".join(parts)


def _verdict(d: Diagnosis) -> str:
    return f"<strong>{_text(figures.headline(d))}</strong><br>{_text(MEANING.get(d.verdict, ''))}"


def html_summary(d: Diagnosis) -> str:
    """Verdict, causes and gain as a fragment of HTML.

    Parameters
    ----------
    d : Diagnosis
        What was found.

    Returns
    -------
    str
        Without images and styles, to be shown in a notebook.
    """
    return f"<div><p>{_verdict(d)}</p>{_causes_table(d)}{_gain_sentence(d)}{_left(d)}</div>"


def html_page(d: Diagnosis) -> str:
    """The whole report as one HTML page that needs no network.

    Parameters
    ----------
    d : Diagnosis
        What was found.

    Returns
    -------
    str
    """
    before, after = figures.sides(d)
    name = d.record.name or "record"
    title = f"{name}: {figures.headline(d)}"
    sections = [
        f"<h1>{_text(f'Diagnosis of {d.axis.name}, {name}')}</h1>",
        f'<div class="verdict">{_verdict(d)}</div>',
        _causes_table(d),
        _gain_sentence(d),
        _left(d),
        "<h2>Simulation beside measurement</h2>",
        *_pictures(d, before, after),
        _evidence_table(before, after),
        _stories(d),
        "<h2>The axis</h2>",
        _acting_table(d),
        f"<p><small>{_text(_MAP_ALONE)}</small></p>" if d.extended.effects else "",
        '<div class="pair">',
        f"<div><h3>as believed</h3><pre>{_text(d.axis.describe())}</pre></div>",
        f"<div><h3>with the causes</h3><pre>{_text(d.extended.describe())}</pre></div>",
        "</div>",
        _usage(d),
        f"<p><small>{_text(_provenance(d))}</small></p>",
    ]
    body = "\n".join(part for part in sections if part)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{_text(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _provenance(d: Diagnosis) -> str:
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
    axes = figure.subplots(1, columns, squeeze=False, sharey=columns > 2)
    draw(axes[0])
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    return buffer.getvalue()


def _picture(data: bytes, alt: str, caption: str) -> str:
    code = base64.b64encode(data).decode("ascii")
    return (
        f'<figure><img src="data:image/png;base64,{code}" alt="{_text(alt)}">'
        f"<figcaption>{_text(caption)}</figcaption></figure>"
    )


def _medians(before: Evidence, after: Evidence | None) -> str:
    unit = before.axis.units[0]
    words = f"median {length_text(float(np.median(before.error_by_window)), unit)} as believed"
    if after is not None:
        found = length_text(float(np.median(after.error_by_window)), unit)
        words += f", {found} with the causes"
    return words


def _pictures(d: Diagnosis, before: Evidence, after: Evidence | None) -> list[str]:
    def residuals(axes: Sequence[Any]) -> None:
        for i, by in enumerate(figures.AGAINST):
            figures.draw_residual(before, after, by, axes[i], legend=i == 0)

    force = before.axis.units[1]
    rms = f"RMS {_number(before.force_rms)} {force} as believed"
    if after is not None:
        rms += f", {_number(after.force_rms)} {force} with the causes"
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
            f"Force residual against speed, position, time and time since reversal; {rms}.",
            "Force that the model would need beside its drive to move as measured. Grey dots: "
            "sliding samples with the axis as believed; lines: medians, over position one for "
            "each direction.",
        ),
    ]
    table = wording.level_table(d)
    if wording.level_varies(table):
        unit = d.axis.units
        pictures.append(
            _picture(
                _png((9.0, 3.2), 1, lambda axes: figures.draw_levels(d, axes[0])),
                "Coulomb level over position; as believed: "
                f"{wording.level_text(table, 'believed', unit)}; with the causes: "
                f"{wording.level_text(table, 'found', unit)}.",
                "Coulomb level, without Stribeck peak and load, with every effect that changes it, "
                "over the range that the record visited. Marks tell the direction: > forwards (x "
                "grows), < backwards.",
            )
        )
    times = candidate_bars.falls(d)
    if candidate_bars.any_bar(d):
        best = next(iter(times))
        pictures.append(
            _picture(
                _png((9.0, 4.2), 1, lambda axes: candidate_bars.draw_candidates(d, axes[0])),
                "Bars: how many times smaller each candidate alone makes the typical error; the "
                f"longest: {wording.title_of(best)}, {wording.plain(times[best])} times.",
                "How many times smaller each candidate, as the only cause, makes the typical "
                "error of free runs that the fit did not see, beside an axis that only gets "
                "other numbers for mass, viscous friction and Coulomb level (1: no better, and "
                "no bar for what is no better or worse). A cause that helps beside the others "
                "only need not stand out here.",
            )
        )
    elif times:
        pictures.append(f"<p>{_text(candidate_bars.NO_BAR)}</p>")
    pictures.append(
        _picture(
            _png((9.0, 2.8), 1, lambda axes: figures.draw_autocorrelation(before, after, axes[0])),
            "Autocorrelation of the force residual over the lag, with the band of white noise.",
            "A residual that is noise stays in the band, but for the shortest lags, which the "
            "smoothing correlates.",
        )
    )
    return pictures


def _evidence_table(before: Evidence, after: Evidence | None) -> str:
    length, force = before.axis.units
    sides = [before] if after is None else [before, after]
    rows = [
        ("force residual, RMS", [f"{_number(s.force_rms)} {force}" for s in sides]),
        ("free runs, RMS error", [length_text(s.position_rms, length) for s in sides]),
        (
            "free runs, median error",
            [length_text(float(np.median(s.error_by_window)), length) for s in sides],
        ),
        ("motion or rest seen otherwise *", [f"{100.0 * s.disagreement:.2g} %" for s in sides]),
    ]
    head = _headings(("whole record", "as believed", "with the causes")[: len(sides) + 1])
    body = "".join(_row([_text(name), *map(_text, cells)]) for name, cells in rows)
    return f"<table>{head}<tbody>{body}</tbody></table><p><small>{_text(_MODES)}</small></p>"


_MODES = (
    "* Part of the samples at which record and free run, both read through the encoder, differ in "
    "whether the axis moves. Near a start or stop steps of the encoder come seldom, so that a "
    "right model differs there too, by some samples each; the verdict does not rest on it."
)
_MAP_ALONE = (
    "Below, the lines Coulomb +, Coulomb - and viscous are the base of the axis alone; the effects "
    "listed under them add to it. The table above has both in it."
)


def _acting_table(d: Diagnosis) -> str:
    """Numbers that act in each direction, all effects included."""
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

    def differ(before: float, after: float) -> bool:
        return abs(after - before) > 1e-9 * abs(before)

    head = _headings(("friction effects included", "as believed", "with the causes", "change"))
    body = "".join(
        _row(
            map(
                _text,
                (
                    name,
                    *(f"{v:.4g}{'' if unit == '1' else ' ' + unit}" for v in (before, after)),
                    wording.change_text("amount", before, after)
                    if differ(before, after)
                    else "none",
                ),
            )
        )
        for name, before, after, unit in rows
    )
    return f"<table>{head}<tbody>{body}</tbody></table>"


def _stories(d: Diagnosis) -> str:
    if not d.main_causes:
        return ""
    parts = ["<h2>What it means</h2>"]
    for cause in d.main_causes:
        parts.append(
            f"<h3>{_text(cause.title)}</h3><p>{_text(cause.explanation)}<br>"
            f"<em>To expose it:</em> {_text(cause.experiment)}</p>"
        )
    return "".join(parts)


def _usage(d: Diagnosis) -> str:
    r = d.record
    quantum = f", encoder_quantum={r.quantum:.4g}" if r.quantum else ""
    code = f"""\
import dryfric_control as dfc

axis = dfc.read_axis("extended.toml")      # or d.extended, right after dfc.diagnose
run = axis.simulate(u, dt={r.dt:.6g})              # u: the drive force, one value a sample
design = dfc.design_pi_observer(axis, dt={r.dt:.6g}{quantum})
"""
    return (
        "<h2>Going on with it</h2><p>The axis with the causes simulates, makes blocks and "
        f"designs observers like any other.</p><pre>{_text(code)}</pre>"
        "<p>Its file <code>extended.toml</code>:</p>"
        f"<pre>{html.escape(axis_text(d.extended))}</pre>"
    )


def write_report(d: Diagnosis, folder: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Write report.html, report.png, diagnosis.json and extended.toml.

    Everything is made before the first file is written.

    Parameters
    ----------
    d : Diagnosis
        What was found.
    folder : path-like
        Where to; made if it is not there.

    Returns
    -------
    tuple of Path
        The files.
    """
    import matplotlib.pyplot as plt

    drawn = d.plot().figure
    buffer = io.BytesIO()
    try:
        drawn.savefig(buffer, format="png", dpi=130)
    finally:
        plt.close(drawn)
    contents = {
        "report.html": html_page(d).encode("utf-8"),
        "report.png": buffer.getvalue(),
        "diagnosis.json": (d.to_json() + "\n").encode("utf-8"),
        "extended.toml": axis_text(d.extended).encode("utf-8"),
    }
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        with replacing(target / name) as part:
            part.write_bytes(content)
    return tuple(target / name for name in contents)
