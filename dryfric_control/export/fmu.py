"""FMUs for co-simulation, with the exported C inside."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control._version import __version__
from dryfric_control.arrays import Floats, Ints
from dryfric_control.compiled import axis_step
from dryfric_control.export.c_code import Code, source_text
from dryfric_control.export.objects import Exported, Signal, export_object
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.store.files import file_path, name_disk_errors, write_file
from dryfric_control.units import powers

VERSIONS = ("3.0", "2.0")
_SYSTEMS = {
    "Linux": ("linux", "so"),
    "Darwin": ("darwin", "dylib"),
    "Windows": ("windows", "dll"),
}
_MACHINES = {
    "amd64": "x86_64",
    "x86_64": "x86_64",
    "arm64": "aarch64",
    "aarch64": "aarch64",
}
_OLD = {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}
_LEAST = 1e-300
#: Parameters of every axis: name, unit, meaning, least value.
_BASE = (
    ("mass", "kg", "moving mass", _LEAST),
    ("viscous", "N s/m", "viscous coefficient", 0.0),
    (
        "stick_speed",
        "m/s",
        "speed below which the axis counts as motionless",
        _LEAST,
    ),
    (
        "stick_rate",
        "1/s",
        "decay rate of the velocity while stuck",
        _LEAST,
    ),
)
_PEAK = (
    ("excess", "1", "height", 0.0),
    ("speed", "m/s", "width", _LEAST),
)

#: A number of an axis, and what a parameter makes it: `factor * value`, or `factor / value` if so.
_Place = tuple[int, float, bool]


def export_fmu(
    obj: Any,
    path: str | os.PathLike[str],
    version: str = "3.0",
    *,
    name: str | None = None,
    dt: float | None = None,
) -> Path:
    """Write an axis, an observer or a compensation as an FMU.

    Parameters
    ----------
    obj : FrictionAxis, ObserverDesign, HybridFilter or Compensation
        What to export.
    path : str or path
        File to write, with the ending ``.fmu``.
    version : {"3.0", "2.0"}, optional
        Version of the Functional Mock-up Interface.
    name : str, optional
        Model identifier, as in `export_c`.
    dt : float, optional
        Sampling time of an axis [s], 1 ms by default: its longest step, and the step of
        its line of delayed drives.  The others have their own.

    Returns
    -------
    Path
        The file: binary for this platform, source, model description.

    Notes
    -----
    It needs a C compiler, and the package ``fmpy`` for the FMI headers.  Longer steps of the plant
    than `dt` are cut into equal pieces; what sets numbers of it in proportion is a parameter.

    Examples
    --------
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0, name="stage")

    ``dfc.export_fmu(axis, "stage.fmu", version="2.0")`` writes it.  The ending says what it is:

    >>> dfc.export_fmu(axis, "stage.zip")
    Traceback (most recent call last):
    ...
    ValueError: path must be a file that ends in .fmu, got 'stage.zip'
    """
    if version not in VERSIONS:
        raise ValueError(f'version must be "3.0" or "2.0", got {version!r}')
    made = export_object(obj, name, dt)
    if made.name in ("model", "fmi", "fmi2", "fmi3"):
        raise ValueError(f'name {made.name!r} is that of a file in every FMU: pass name="..."')
    target = file_path("path", path)
    if target.suffix != ".fmu" or target.is_dir():
        raise ValueError(f"path must be a file that ends in .fmu, got {str(path)!r}")
    if not target.parent.is_dir():
        raise ValueError(f"path {str(path)!r} is in no folder that there is: make it first")
    model = Model(made, version)
    content = model.archive_bytes()
    with name_disk_errors(f"path {str(path)!r}"):
        write_file(target, content)
    return target


def settings(axis: FrictionAxis, dt: float) -> list[tuple[Signal, list[_Place]]]:
    """Parameters that set numbers of an axis in proportion, found by changing each, and those."""
    base = axis.arrays(dt).numbers
    # The code is written for these; of several shortest lengths each sets the least.
    fixed = {axis_step.DELAY, axis_step.LAG}
    if sum(math.isfinite(min(e.shortest_length, e.shortest_time)) for e in axis.effects) > 1:
        fixed |= {axis_step.SHORT_WAY, axis_step.SHORT_TIME}
    bounds = _bounds(axis.arrays(dt).integers)
    found = []
    for parameter, changed in _parameters(axis):
        value = parameter.start or 0.0
        moved = value * 1.01 if value else 1e-3
        try:
            other = changed(moved).arrays(dt).numbers
        except ValueError:
            continue
        places = _proportional_places(base, other, value, moved, bounds)
        if places and fixed.isdisjoint(place for place, _, _ in places):
            low = parameter.low
            if any(inverse for _, _, inverse in places):
                low = max(low, _LEAST)
            found.append((replace(parameter, low=low), places))
    return found


def _bounds(integers: Ints) -> set[int]:
    """Places of the numbers of an axis that are bounds: of slopes, and ends of straight pieces."""
    count = integers[[axis_step.N_INPUT, axis_step.N_FORCE, axis_step.N_LEVEL]].sum()
    firsts = integers[axis_step.LAWS + 1 :: 2][:count]
    slopes = (firsts[:, None] + range(axis_step.BY_TIME, 0)).ravel()
    # With two masses the numbers are stored twice.
    slopes = np.concatenate((slopes, slopes + integers[axis_step.N_NUMBERS]))
    corners = integers[axis_step.CORNERS] + range(integers[axis_step.N_CORNERS])
    return {*slopes.tolist(), *corners.tolist()}


def _proportional_places(
    base: Floats, other: Floats, value: float, moved: float, bounds: set[int]
) -> list[_Place] | None:
    """Numbers that a parameter sets in proportion; None if it changes others, too."""
    if other.size != base.size:
        return None
    places = []
    for i in np.flatnonzero(base != other).tolist():
        place = _place(i, value, moved, base[i], other[i])
        if place is not None:
            places.append(place)
        elif i not in bounds:  # bounds follow where they are in proportion, and else stay
            return None
    return places


def _place(place: int, value: float, moved: float, before: float, after: float) -> _Place | None:
    """How a number follows a parameter: in proportion, as a reciprocal, or neither."""
    if math.isclose(before * moved, after * value, rel_tol=1e-9, abs_tol=_LEAST):
        return place, _exact(after / moved), False
    if math.isclose(before * value, after * moved, rel_tol=1e-9):
        return place, _exact(after * moved), True
    return None


def _exact(factor: float) -> float:
    """A factor that is one but for rounding as one."""
    return 1.0 if math.isclose(factor, 1.0, rel_tol=1e-12) else factor


def _parameters(axis: FrictionAxis) -> Iterator[tuple[Signal, Any]]:
    """Every parameter of an axis, and the axis as a function of its value."""

    def parameter_signal(
        name: str,
        unit: str,
        meaning: str,
        value: float,
        low: float,
        high: float = math.inf,
    ) -> Signal:
        return Signal(
            name,
            unit,
            meaning,
            causality="parameter",
            start=value,
            low=low,
            high=high,
        )

    for name, unit, meaning, least in _BASE:
        yield (
            parameter_signal(name, axis.unit(unit), meaning, getattr(axis, name), least),
            lambda v, name=name: axis.replace(**{name: v}),
        )
    for side in ("plus", "minus"):
        for i, c in enumerate(levels := getattr(axis.coulomb, side)):
            unit = axis.unit(f"N/m^{i}" if i else "N")
            least = -math.inf if i else 0.0
            others = levels[:i], levels[i + 1 :]
            yield (
                parameter_signal(
                    f"coulomb_{side}_{i}",
                    unit,
                    f"Coulomb level, coefficient of x^{i}",
                    c,
                    least,
                ),
                lambda v, side=side, others=others: axis.replace(
                    coulomb=replace(
                        axis.coulomb,
                        **{side: (*others[0], v, *others[1])},
                    )
                ),
            )
    if (peak := axis.stribeck) is not None:
        for name, unit, what, least in _PEAK:
            words = f"{what} of the Stribeck peak"
            yield (
                parameter_signal(
                    f"stribeck_{name}",
                    axis.unit(unit),
                    words,
                    getattr(peak, name),
                    least,
                ),
                lambda v, name=name: axis.replace(stribeck=replace(peak, **{name: v})),
            )
    for slug, effect in axis.named_effects().items():
        units = type(effect).units(axis.units)
        for item in fields(effect) if effect in axis.effects else ():
            about = item.metadata
            choice = about["kind"] == "share" and not about["free"]
            if choice or item.name in effect.unused_parameters:
                continue  # of the structure, which the code is written for
            more = (
                item.metadata["doc"],
                getattr(effect, item.name),
                *item.metadata["bounds"],
            )
            yield (
                parameter_signal(f"{slug}_{item.name}", units[item.name], *more),
                lambda v, e=effect, n=item.name: axis.replace(
                    effects=[replace(o, **{n: v}) if o is e else o for o in axis.effects]
                ),
            )


class Model:
    """Files of one FMU: an exported object at a version of the interface."""

    def __init__(self, made: Exported, version: str) -> None:
        self.made = made
        self.version = version
        self.major = version[0]
        self.code = Code(made)
        self.settings = settings(made.axis.effective(), made.dt) if made.moves else []
        self.variables = self._variables()
        self.model = self._model()
        text = self.code.source + self.model + version
        self.token = hashlib.sha256(text.encode("utf-8")).hexdigest()[:32]
        self.model = self.model.replace("@TOKEN@", self.token)

    def _variables(self) -> list[Signal]:
        """Variables in the order of their references, which count from 1."""
        made = self.made
        rows = [replace(s, causality="input", start=0.0) for s in made.inputs]
        names = {s.name: f"u_{s.name}" for s in made.inputs}
        for s in made.outputs:
            rows.append(replace(s, causality="output", name=names.get(s.name, s.name)))
        if made.moves:
            words = "switches located in the last step"
            rows.append(Signal("switches", "1", words, whole=True, causality="output"))
        for s, _ in made.starts:
            rows.append(replace(s, causality="parameter", start=0.0, fixed=True))
        return rows + [variable for variable, _ in self.settings]

    def _model(self) -> str:
        """The model behind the interface: its variables, start and step."""
        made = self.made
        rows = [
            (*place, len(made.starts) + i)
            for i, (_, places) in enumerate(self.settings)
            for place in places
        ]
        numbers = made.tables.get("numbers", np.zeros(0))
        return self.code.render(
            "model.c.jinja",
            late=bool(made.moves and numbers[axis_step.DELAY] > 0.0),
            size=numbers.size,
            settings=[v for v in self.variables if v.causality == "parameter"],
            first=1 + len(made.inputs) + len(made.outputs) + made.moves,
            rows=rows,
        )

    @property
    def files(self) -> dict[str, str]:
        """Names and texts of the source."""
        n = self.made.name
        return {
            f"fmi{self.major}.c": source_text(f"fmi{self.major}.c"),
            "fmi.c": source_text("fmi.c"),
            "model.c": self.model,
            f"{n}.c": self.code.source,
            f"{n}.h": self.code.header,
        }

    def archive_bytes(self) -> bytes:
        """The whole FMU."""
        binary, library = self.library()
        content: dict[str, bytes] = {"modelDescription.xml": self.description().encode("utf-8")}
        content |= {f"sources/{name}": text.encode("utf-8") for name, text in self.files.items()}
        if self.major == "3":
            build = self.code.render("buildDescription.xml.jinja", version=self.version)
            content["sources/buildDescription.xml"] = build.encode("utf-8")
        content["documentation/README.md"] = self.code.readme_text().encode("utf-8")
        content[f"binaries/{binary}"] = library
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in content.items():
                # One date for all: the same object gives the same file.
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, data)
        return buffer.getvalue()

    def library(self) -> tuple[str, bytes]:
        """Path and content of the library for this platform."""
        compiler = next((c for c in ("gcc", "cc", "clang") if shutil.which(c)), None)
        if compiler is None:
            raise ValueError(
                "there is no C compiler (gcc, cc or clang) for the binary of the FMU: install one, "
                "or take export_c"
            )
        system, ending = _SYSTEMS.get(platform.system(), (sys.platform, "so"))
        machine = _MACHINES.get(platform.machine().lower(), platform.machine())
        place = _OLD.get(system, system) if self.major == "2" else f"{machine}-{system}"
        name = f"{self.made.name}.{ending}"
        with tempfile.TemporaryDirectory() as folder:
            for file, text in self.files.items():
                (Path(folder) / file).write_text(text, encoding="utf-8")
            command = [
                compiler,
                "-std=c99",
                "-O2",
                "-ffp-contract=off",
                "-shared",
                "-fPIC",
                "-Wall",
                "-Wextra",
                f"-I{fmi_headers()}",
                f"fmi{self.major}.c",
                "-o",
                name,
                "-lm",
            ]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            if done.returncode:
                raise ValueError(f"{compiler} refuses the C: {done.stderr.strip()[-600:]}")
            return f"{place}/{name}", (Path(folder) / name).read_bytes()

    def description(self) -> str:
        """modelDescription.xml."""
        units = sorted({v.unit for v in self.variables} - {"1", ""} | {"s"})
        rotary = self.made.axis.units != ("m", "N")
        return self.code.render(
            "modelDescription.xml.jinja",
            version=self.version,
            package=__version__,
            token=self.token,
            infinity=math.inf,
            units=[(unit, _base_unit(unit, rotary)) for unit in units],
            variables=self.variables,
            outputs=[i for i, v in enumerate(self.variables, 1) if v.causality == "output"],
        )


def _base_unit(unit: str, rotary: bool) -> str:
    """A unit in SI base units."""
    force, length, time = powers(unit)
    exponents = {"kg": force, "m": force + length, "s": time - 2 * force}
    inner = " ".join(f'{name}="{power}"' for name, power in exponents.items() if power)
    # On a rotary axis the radian is the length: the name alone is safe.
    return f"<BaseUnit {inner}/>" if inner and not rotary else ""


def fmi_headers() -> Path:
    """Folder of the FMI headers, which the package fmpy ships under their own licence."""
    found = importlib.util.find_spec("fmpy")
    folder = Path(found.origin).parent / "c-code" if found and found.origin else None
    if folder is None or not (folder / "fmi3Functions.h").is_file():
        raise ValueError(
            "the FMI headers come with the package fmpy, which is not installed: "
            'pip install "dryfric-control[fmu]"'
        )
    return folder
