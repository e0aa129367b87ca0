"""The force that a model lacks, redrawn while the user turns its numbers."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from dryfric_control.arrays import Floats
from dryfric_control.checks import finite, instance, known_keys
from dryfric_control.drawing import MEASURED, PanelPlot, axes_of, control_plot, label_axes
from dryfric_control.estimation.smoothed_motion import (
    SmoothedMotion,
    drive_at_the_mass,
    known_force,
    missing_force,
)
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects import BiasForce, Spring
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.records.record import Record
from dryfric_control.store.files import write_file
from dryfric_control.text import rotary_words, typeset_signs
from dryfric_control.units import check_units

# Dots that are drawn; more are not told apart.
_DOTS = 1200
# Width and height of the picture [in], its resolution.
_SIZE = (8.0, 3.2)
_DPI = 80
# Largest value of a slider over the nominal one.
_REACH = 3.0
# Stribeck velocities of the slider, over the largest velocity.
_SLOWEST = 1e-3
_FASTEST = 0.3
_STEPS = 200
# Stribeck velocities of the page.
_SPEEDS = 24
# Digits of its numbers: what a picture shows.
_DIGITS = 6
# What is written beside a slider, on a linear axis.
_LABELS = {
    "mass": "mass",
    "viscous": "viscous friction",
    "coulomb": "Coulomb level",
    "excess": "Stribeck peak",
    "stribeck_speed": "Stribeck velocity",
    "stiffness": "spring stiffness",
    "constant": "constant force",
}
# Unit of the peak: the excess of breakaway over the Coulomb level is a part of that.
_OF_LEVEL = "of Coulomb level"
# Width of these words in a notebook.
_LABEL_WIDTH = "8.5em"


@dataclass(frozen=True)
class Slider:
    """One number of the model: where it starts, its range, unit and label."""

    value: float
    low: float
    high: float
    unit: str
    label: str


class ForceExplorer:
    """What remains of the drive over velocity and position, with the numbers of a model to turn.

    In a notebook with ipywidgets it has sliders; elsewhere it is a picture, and `set` turns the
    numbers.  `axis` is the model as it stands, to go on with.

    Parameters
    ----------
    record : Record
    axis : FrictionAxis
        The model to start from.
    hold : {"zero", "first"}, optional
        Whether the recorded input is held or interpolated linearly between samples.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.4, viscous=12.0, coulomb=7.0)
    >>> look = dfc.datasets.belt_stage().explore(axis)
    >>> before = look.rms
    >>> look.set(coulomb=9.0)
    >>> look.rms < before, look.axis.coulomb.mean
    (True, 9.0)
    """

    def __init__(self, record: Record, axis: FrictionAxis, hold: str = "zero") -> None:
        instance("axis", axis, FrictionAxis)
        check_units(axis, record)
        self._start = axis.effective()
        self._motion = SmoothedMotion.from_record(record, self._start.mass)
        self._drive = drive_at_the_mass(self._start, record, hold)
        self._known = known_force(record, hold)
        at = self._motion.places
        self._shown = slice(None, None, max(1, at.size // _DOTS))
        self._v, self._x = self._motion.v[at], self._motion.x[at]
        self._middle = 0.5 * (float(record.x.min()) + float(record.x.max()))
        self.sliders: dict[str, Slider] = self._ranges(record)
        self.values = {name: one.value for name, one in self.sliders.items()}
        self._scale = 0.0
        self._canvas: Any = None
        self._frame: Any = None
        self._moving: list[Any] = []

    def _ranges(self, record: Record) -> dict[str, Slider]:
        axis, unit = self._start, self._start.unit
        level, peak = axis.coulomb.mean, axis.stribeck or Stribeck(excess=0.0, speed=1.0)
        fastest = float(np.abs(self._v).max(initial=1e-12))
        speed = peak.speed if axis.stribeck else 0.03 * fastest
        stiffness = 2.0 * level / max(record.range, 1e-300)
        ranges = {
            "mass": (axis.mass, 0.0, _REACH * axis.mass, unit("kg")),
            "viscous": (
                axis.viscous, 0.0, max(_REACH * axis.viscous, level / fastest), unit("N s/m")
            ),
            "coulomb": (level, 0.0, _REACH * level, unit("N")),
            "excess": (peak.excess, 0.0, max(1.0, 2.0 * peak.excess), _OF_LEVEL),
            "stribeck_speed": (speed, _SLOWEST * fastest, _FASTEST * fastest, unit("m/s")),
            "stiffness": (0.0, 0.0, stiffness, unit("N/m")),
            "constant": (0.0, -level, level, unit("N")),
        }  # fmt: skip
        words = {name: rotary_words(label, axis.units[1]) for name, label in _LABELS.items()}
        return {name: Slider(*one, words[name]) for name, one in ranges.items()}

    def set(self, **values: float) -> None:
        """Turn some of the numbers.

        Parameters
        ----------
        **values : float
            mass (inertia of a rotary axis), viscous, coulomb, excess and stribeck_speed of the
            axis; stiffness and constant of a line over position, a spring at rest in the middle of
            the record and a bias force.
        """
        if "inertia" in values and self._start.units[0] == "rad":
            values["mass"] = values.pop("inertia")
        known_keys("explore.", values, self.sliders)
        self.values |= {name: finite(name, value) for name, value in values.items()}

    @property
    def axis(self) -> FrictionAxis:
        """The model with these numbers."""
        return self._axis_of(self.values)

    def _axis_of(self, given: Mapping[str, float]) -> FrictionAxis:
        start = self._start
        factor = max(given["coulomb"], 1e-12) / start.coulomb.mean
        peak = Stribeck(given["excess"], given["stribeck_speed"]) if given["excess"] > 0.0 else None
        effects = list(start.effects)
        if given["stiffness"] > 0.0:
            effects.append(Spring(stiffness=given["stiffness"], rest=self._middle))
        if given["constant"] != 0.0:
            effects.append(BiasForce(given["constant"]))
        return start.replace(
            mass=max(given["mass"], 1e-12),
            viscous=max(given["viscous"], 0.0),
            coulomb=CoulombMap.of(start.coulomb.scaled(factor)),
            stribeck=peak,
            effects=tuple(effects),
        )

    @property
    def missing(self) -> Floats:
        """Force that is missing in the sliding samples, shape (m,)."""
        return self._missing(self.values)

    def _missing(self, given: Mapping[str, float]) -> Floats:
        left = missing_force(self._axis_of(given), self._motion, self._drive, self._known)
        return self._motion.smooth_columns(left[:, None])[:, 0]

    @property
    def rms(self) -> float:
        """RMS of the force that is missing."""
        return float(np.sqrt(np.mean(self.missing**2)))

    def plot(self, ax: Any = None, title: str | None = None) -> PanelPlot:
        """Draw the force that is missing over velocity and over position.

        Parameters
        ----------
        ax : sequence of two Axes, optional
            Where to draw.  Default: a new figure.
        title : str, optional
            Title.  Default: its RMS.
        """
        axes = axes_of(ax, 2, title, sharex=False, figsize=(7.0, 5.0))
        self._draw(axes)
        axes[0].set_title(self._title() if title is None else title, loc="left")
        return control_plot(axes)

    def _title(self, left: Floats | None = None) -> str:
        rms = self.rms if left is None else float(np.sqrt(np.mean(left**2)))
        words = f"force missing in the model: {rms:.3g} {self._start.units[1]} RMS"
        return typeset_signs(rotary_words(words, self._start.units[1]))

    def _draw(self, axes: Any) -> list[Any]:
        length, force = self._start.units
        left, lines = self.missing[self._shown], []
        for one, over, words in (
            (axes[0], self._v, f"velocity [{length}/s]"),
            (axes[1], self._x, f"position [{length}]"),
        ):
            one.axhline(0.0, color="k", lw=0.8)
            lines += one.plot(over[self._shown], left, ".", color=MEASURED, ms=3)
            label_axes(
                one,
                typeset_signs(words),
                typeset_signs(rotary_words(f"force [{force}]", force)),
                legend=False,
            )
        return lines

    def png(self) -> bytes:
        """The picture of now; its frame is kept as long as the dots are in it."""
        left = self.missing[self._shown]
        largest = 1.1 * max(float(np.abs(left).max(initial=0.0)), 1e-300)
        if not 0.2 * self._scale < largest < self._scale:
            self._scale = 1.3 * largest
            self._canvas = FigureCanvasAgg(Figure(figsize=_SIZE, dpi=_DPI, layout="constrained"))
            axes = self._canvas.figure.subplots(1, 2, sharey=True)
            self._moving = [*self._draw(axes), axes[0].set_title(" ", loc="left")]
            axes[0].set_ylim(-self._scale, self._scale)
            for one in self._moving:
                one.set_animated(True)
            self._canvas.draw()
            self._frame = self._canvas.copy_from_bbox(self._canvas.figure.bbox)
        self._canvas.restore_region(self._frame)
        *lines, title = self._moving
        title.set_text(self._title(left))
        for line in lines:
            line.set_ydata(left)
        for one in self._moving:
            one.axes.draw_artist(one)
        out = io.BytesIO()
        pixels = np.asarray(self._canvas.buffer_rgba())
        imsave(out, pixels, format="png", pil_kwargs={"compress_level": 1})
        return out.getvalue()

    def to_html(self, path: str | os.PathLike[str]) -> Path:
        """Write a page with the sliders, which stands alone: no server, no network.

        Parameters
        ----------
        path : path-like
            Its file; numbers in its address, as in ``page.html#coulomb=9``, are those it begins
            with.

        Returns
        -------
        Path
        """
        write_file(path, self._page)
        return Path(path)

    def _page(self) -> str:
        """The page as text."""
        page = jinja2.Environment(
            loader=jinja2.PackageLoader("dryfric_control.estimation", "."), autoescape=True,
            undefined=jinja2.StrictUndefined,
        ).get_template("force_explorer.html")  # fmt: skip
        length, force = self._start.units
        words = rotary_words("force missing in the model", force)
        return page.render(
            title=words, data=self._columns(), sliders=self.sliders, steps=_STEPS, length=length,
            force=force, axis_label=rotary_words("force", force),
        )  # fmt: skip

    def _columns(self) -> str:
        """Missing force of the dots as a sum of columns, by number of the model, as JSON."""
        none = dict.fromkeys(self.values, 0.0) | {
            "stribeck_speed": self.sliders["stribeck_speed"].value
        }

        def left(**values: float) -> Floats:
            return self._missing(none | values)[self._shown]

        def round_list(values: Floats) -> list[float]:
            return [float(f"{value:.{_DIGITS}g}") for value in values]

        base, level = left(), left(coulomb=1.0)
        speed = self.sliders["stribeck_speed"]
        speeds = np.geomspace(speed.low, speed.high, _SPEEDS)
        linear = ("mass", "viscous", "coulomb", "stiffness", "constant")
        peaks = [left(coulomb=1.0, excess=1.0, stribeck_speed=float(one)) - level for one in speeds]
        return json.dumps({
            "v": round_list(self._v[self._shown]), "x": round_list(self._x[self._shown]),
            "base": round_list(base), "columns": {name: round_list(left(**{name: 1.0}) - base)
                                             for name in linear},
            "speeds": round_list(speeds), "peaks": [round_list(one) for one in peaks],
            "sliders": {
                name: asdict(one) | {"unit": typeset_signs(one.unit)}
                for name, one in self.sliders.items()
            },
        }).replace("<", "\\u003c")  # fmt: skip

    def _repr_png_(self) -> bytes:
        return self.png()

    def __repr__(self) -> str:
        first = "inertia" if self._start.units[0] == "rad" else "mass"
        named = {first if name == "mass" else name: one for name, one in self.values.items()}
        given = ", ".join(f"{name} = {value:.4g}" for name, value in named.items())
        return f"{self._title()}\n{given}\nsliders in a notebook need ipywidgets; .set({first}=...)"

    def _ipython_display_(self) -> None:
        from IPython.display import Image, display

        try:
            import ipywidgets
        except ImportError:
            print('no sliders: pip install "dryfric-control[interactive]"')
            display(Image(self.png()))
            return
        display(self.panel(ipywidgets))

    def panel(self, widgets: Any) -> Any:
        """The sliders above the picture, of the module ipywidgets."""
        picture = widgets.Image(value=self.png(), format="png")
        rows = []
        for name, one in self.sliders.items():
            style = {"description_width": _LABEL_WIDTH}
            options = {"description": one.label, "readout_format": ".3g", "style": style}
            if name == "stribeck_speed":
                low, high = np.log10([one.low, one.high])
                step = (high - low) / _STEPS
                row = widgets.FloatLogSlider(one.value, min=low, max=high, step=step, **options)
            else:
                step = (one.high - one.low) / _STEPS
                row = widgets.FloatSlider(
                    one.value, min=one.low, max=one.high, step=step, **options
                )
            row.observe(
                lambda change, name=name: self._change_values(picture, {name: change.new}), "value"
            )
            rows.append(widgets.HBox([row, widgets.Label(typeset_signs(one.unit))]))
        return widgets.VBox([*rows, picture])

    def _change_values(self, picture: Any, values: Mapping[str, float]) -> None:
        self.set(**values)
        picture.value = self.png()
