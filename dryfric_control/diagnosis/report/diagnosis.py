"""A diagnosis, as an object that shows itself."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np

from dryfric_control.diagnosis.experiment import Experiment
from dryfric_control.diagnosis.remaining import Remaining
from dryfric_control.diagnosis.report.figures import plot_diagnosis
from dryfric_control.diagnosis.report.findings import (
    Cause,
    Findings,
    Gain,
    Unexplained,
    believed_values,
)
from dryfric_control.diagnosis.report.page import html_page, html_summary
from dryfric_control.diagnosis.report.wording import brief_lines, level_table, summary_lines
from dryfric_control.model.effects.naming import titles_of
from dryfric_control.records.record import Record
from dryfric_control.result_table import Cell, Quantity, format_table
from dryfric_control.store.axis_file import axis_text, axis_to_dict
from dryfric_control.store.files import write_file
from dryfric_control.store.saved import Saved
from dryfric_control.text import Result, documented, plain_data, wrap_lines


@documented
@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Saved, Result, Findings):
    """What is wrong in a simulation, why, what a correction gains.

    Made by `diagnose`.

    Examples
    --------
    A torque constant 20 % off, seen from the record alone:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> believed = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    >>> machine = believed.replace(effects=(dfc.effects.InputGain(gain=1.2),))
    >>> t = 1e-3 * np.arange(6000)
    >>> u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    >>> x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    >>> d = dfc.diagnose(believed, dfc.Record(t, u, x))
    >>> d.verdict, d.causes[0].effect, d.gain.ratio > 10.0
    ('explained', 'input_gain', True)
    >>> d.extended.effects[0].slug
    'input_gain'
    """

    _kind = "diagnosis"
    _holds = (Cause, Gain, Unexplained, Remaining, Experiment, Record)

    def _summary_parts(self) -> list[str]:
        return summary_lines(self)

    def __repr__(self) -> str:
        return wrap_lines(brief_lines(self))

    def details(self) -> str:
        """Everything that there is to see, in plain lines."""
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """Everything found, ready for JSON."""
        plain = (
            "gain",
            "unexplained",
            "remaining",
            "references",
            "varies",
            "next_experiment",
            "messages",
            "not_tried",
            "standard_errors",
        )
        return {
            "verdict": self.verdict,
            "causes": [
                c.to_dict() | {"believed": believed_values(self.axis, c)} for c in self.causes
            ],
            "small_corrections": [cause.effect for cause in self.small_corrections],
            "coulomb_level": level_table(self),
            "axis": axis_to_dict(self.axis),
            "extended": axis_to_dict(self.extended),
            **{name: plain_data(getattr(self, name)) for name in plain},
            "masked": [
                {"indices": m.indices.tolist(), "reasons": list(m.reasons)} for m in self.masked
            ],
            "scores": {k: v for k, v in self.scores.items() if np.isfinite(v)},
        }

    def to_json(self, path: str | os.PathLike[str] | None = None) -> str:
        """The same as text, written to a file if a path is given.

        Parameters
        ----------
        path : path-like, optional
            File to write, replaced as a whole or not at all.
        """
        text = json.dumps(self.to_dict(), indent=2)
        if path is not None:
            write_file(path, text)
        return text

    def table(self, form: str = "markdown") -> str:
        """Causes, parameters and alternatives as a table.

        Parameters
        ----------
        form : {"markdown", "latex", "csv"}, optional
            "latex" needs the packages booktabs and siunitx, "csv" has all digits.
        """
        rows: list[tuple[Cell, ...]] = []
        for cause in self.causes:
            nominal = believed_values(self.axis, cause)
            others = ", ".join(map(titles_of, cause.alternatives)) or "none"
            for name, value in cause.parameters.items():
                unit = cause.units[name]
                error = cause.standard_errors[name]
                before = Quantity(nominal[name], None, unit) if name in nominal else "none"
                rows.append((cause.title, name, before, Quantity(value, error, unit), others))
        return format_table(("cause", "parameter", "nominal", "value", "alternatives"), rows, form)

    def plot(self, ax: Any = None) -> ct.ControlPlot:
        """Draw the report on one page.

        Parameters
        ----------
        ax : sequence of nine Axes, optional
            Where to draw simulated - measured position, the errors of the free runs, the force
            residual against velocity, position, time and time since reversal, friction over
            velocity, the candidates and the autocorrelation.  Default: a new figure, with the
            verdict in words.

        Raises
        ------
        ValueError
            If another number of axes is given.
        """
        return plot_diagnosis(self, ax)

    def to_html(self, path: str | os.PathLike[str]) -> None:
        """Write a self-contained report that opens without a network.

        Parameters
        ----------
        path : path-like
            File to write, replaced as a whole or not at all.
        """
        write_file(path, lambda: html_page(self))

    def _repr_html_(self) -> str:
        return html_summary(self)


def write_report(
    d: Diagnosis, folder: str | os.PathLike[str], record: Mapping[str, Any] | None = None
) -> tuple[Path, ...]:
    """Write report.html, report.png, diagnosis.json, extended.toml and saved.json into a folder.

    `record` is the table of the axis file that says how records are read.
    """
    # All but the last file is made before the first is written.
    drawn = d.plot().figure
    buffer = io.BytesIO()
    try:
        drawn.savefig(buffer, format="png", dpi=130)
    finally:
        plt.close(drawn)
    contents: dict[str, str | bytes] = {
        "report.html": html_page(d),
        "report.png": buffer.getvalue(),
        "diagnosis.json": d.to_json() + "\n",
        "extended.toml": axis_text(d.extended, record),
    }
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        write_file(target / name, content)
    d.save(target / "saved.json")
    return *(target / name for name in contents), target / "saved.json"
