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
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from dryfric_control._version import __version__
from dryfric_control.checks import file_path
from dryfric_control.compiled import axis_step
from dryfric_control.export.c_code import Code, source_text
from dryfric_control.export.objects import Exported, exported
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.effect import Effect
from dryfric_control.model.friction import CoulombMap, Stribeck
from dryfric_control.store.files import replacing
from dryfric_control.text import rotary_words
from dryfric_control.units import powers

VERSIONS = ("3.0", "2.0")
_SYSTEMS = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("windows", "dll")}
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
_OLD = {"linux": "linux64", "darwin": "darwin64", "windows": "win64"}
_LEAST = 1e-300


@dataclass(frozen=True)
class Parameter:
    """A parameter of an axis, and the numbers of the axis that it sets.

    A number is ``factor * value``, or ``factor / value`` where it is a reciprocal.
    """

    name: str
    unit: str
    meaning: str
    value: float
    low: float
    high: float
    places: tuple[tuple[int, float, bool], ...]


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
    It needs a C compiler, and the package ``fmpy`` for the FMI headers.

    The plant holds its input over a communication step of any length and locates its switches
    inside it; longer steps than `dt` are cut into equal pieces.  With a delay of the drive a
    step is a whole number of samples.  Parameters that set numbers of the axis in proportion can
    be set.

    Observer and compensation take a sample at every multiple of their `dt` that a step
    begins at or contains, with the inputs of that step.  In a loop they go first: readings
    to the controller, its step, its drive to the plant, the plant's step.

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
    made = exported(obj, name, dt)
    if made.name in ("model", "fmi", "fmi2", "fmi3"):
        raise ValueError(f'name {made.name!r} is that of a file in every FMU: pass name="..."')
    target = file_path("path", path)
    if target.suffix != ".fmu" or target.is_dir():
        raise ValueError(f"path must be a file that ends in .fmu, got {str(path)!r}")
    if not target.parent.is_dir():
        raise ValueError(f"path {str(path)!r} is in no folder that there is: make it first")
    model = Model(made, version)
    content = model.zipped()
    try:
        with replacing(target) as part:
            part.write_bytes(content)
    except OSError as problem:
        raise ValueError(
            f"path {str(path)!r} cannot be written ({problem.strerror}): name another"
        ) from None
    return target


def parameters(axis: FrictionAxis, dt: float) -> list[Parameter]:
    """Parameters that set numbers of an axis in proportion, found by changing each."""
    base = axis.arrays(dt).numbers
    # The code is written for these; of several shortest lengths each sets the least.
    fixed = {axis_step.DELAY, axis_step.LAG}
    if sum(math.isfinite(min(e.shortest_length, e.shortest_time)) for e in axis.effects) > 1:
        fixed |= {axis_step.SHORT_WAY, axis_step.SHORT_TIME}
    found = []
    for name, unit, meaning, value, low, high, changed in _candidates(axis):
        moved = value * 1.01 if value else 1e-3
        try:
            other = changed(moved).arrays(dt).numbers
        except ValueError:
            continue
        if other.size != base.size:
            continue
        touched = np.flatnonzero(base != other).tolist()
        places = [_place(i, value, moved, base[i], other[i]) for i in touched if i not in fixed]
        if not places or len(places) < len(touched) or None in places:
            continue
        known = tuple(place for place in places if place is not None)
        least = max(low, _LEAST) if any(inverse for _, _, inverse in known) else low
        found.append(Parameter(name, unit, meaning, value, least, high, known))
    return found


def _place(
    place: int, value: float, moved: float, before: float, after: float
) -> tuple[int, float, bool] | None:
    """How a number follows a parameter: in proportion, as a reciprocal, or neither."""
    if math.isclose(before * moved, after * value, rel_tol=1e-9, abs_tol=_LEAST):
        return place, _exact(after / moved), False
    if math.isclose(before * value, after * moved, rel_tol=1e-9):
        return place, _exact(after * moved), True
    return None


def _exact(factor: float) -> float:
    """A factor that is one but for rounding as one."""
    return 1.0 if math.isclose(factor, 1.0, rel_tol=1e-12) else factor


def _candidates(axis: FrictionAxis) -> list[tuple[Any, ...]]:
    """Name, unit, meaning, value, bounds and changed axis of every parameter."""
    rows: list[tuple[Any, ...]] = []

    def base(name: str, unit: str, meaning: str, least: float) -> None:
        value = getattr(axis, name)
        rows.append(
            (name, axis.unit(unit), meaning, value, least, math.inf,
             lambda v: axis.replace(**{name: v}))
        )  # fmt: skip

    base("mass", "kg", "moving mass", _LEAST)
    base("viscous", "N s/m", "viscous coefficient", 0.0)
    base("stick_speed", "m/s", "speed below which the axis counts as motionless", _LEAST)
    base("stick_rate", "1/s", "decay rate of the velocity while stuck", _LEAST)
    for side in ("plus", "minus"):
        for i, c in enumerate(getattr(axis.coulomb, side)):
            rows.append(
                (f"coulomb_{side}_{i}", axis.unit("N" if i == 0 else f"N/m^{i}"),
                 f"Coulomb level, coefficient of x^{i}", c, -math.inf if i else 0.0, math.inf,
                 lambda v, side=side, i=i: axis.replace(coulomb=_with(axis.coulomb, side, i, v)))
            )  # fmt: skip
    if axis.stribeck is not None:
        peak = axis.stribeck
        rows.append(
            ("stribeck_excess", "1", "height of the Stribeck peak", peak.excess, 0.0, math.inf,
             lambda v: axis.replace(stribeck=Stribeck(v, peak.speed)))
        )  # fmt: skip
        rows.append(
            ("stribeck_speed", axis.unit("m/s"), "width of the Stribeck peak", peak.speed, _LEAST,
             math.inf, lambda v: axis.replace(stribeck=Stribeck(peak.excess, v)))
        )  # fmt: skip
    for slug, effect in axis.named_effects().items():
        if effect not in axis.effects:
            continue
        units = type(effect).units(axis.units)
        for item in fields(effect):
            low, high = item.metadata["bounds"]
            rows.append(
                (f"{slug}_{item.name}", units[item.name], item.metadata["doc"],
                 getattr(effect, item.name), low, high,
                 lambda v, e=effect, n=item.name: axis.replace(effects=_altered(axis, e, n, v)))
            )  # fmt: skip
    return rows


def _with(levels: CoulombMap, side: str, i: int, value: float) -> CoulombMap:
    """Coulomb levels with one coefficient changed."""
    one = getattr(levels, side)
    return replace(levels, **{side: (*one[:i], value, *one[i + 1 :])})


def _altered(axis: FrictionAxis, effect: Effect, name: str, value: float) -> list[Effect]:
    """Effects of an axis with one parameter of one of them changed."""
    return [replace(e, **{name: value}) if e is effect else e for e in axis.effects]


@dataclass(frozen=True)
class Variable:
    """A variable of the model description."""

    name: str
    unit: str
    meaning: str
    causality: str  # "input", "output", "parameter"
    start: float | None = None
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False
    fixed: bool = False  # set before the start alone

    def __post_init__(self) -> None:
        object.__setattr__(self, "meaning", rotary_words(self.meaning, self.unit))


class Model:
    """Files of one FMU: an exported object at a version of the interface."""

    def __init__(self, made: Exported, version: str) -> None:
        self.made, self.version, self.major = made, version, version[0]
        self.code = Code(made)
        self.parameters = parameters(made.axis.effective(), made.dt) if made.moves else []
        self.variables = self._variables()
        self.model = self._model()
        text = self.code.source + self.model + version
        self.token = hashlib.sha256(text.encode("utf-8")).hexdigest()[:32]
        self.model = self.model.replace("@TOKEN@", self.token)

    def _variables(self) -> list[Variable]:
        """Variables in the order of their references, which count from 1."""
        made = self.made
        rows = [Variable(s.name, s.unit, s.meaning, "input", 0.0) for s in made.inputs]
        rows += [
            Variable(
                f"u_{s.name}" if s.name in {i.name for i in made.inputs} else s.name,
                s.unit, s.meaning, "output", whole=s.whole,
            )
            for s in made.outputs
        ]  # fmt: skip
        if made.moves:
            words = "switches located in the last step"
            rows.append(Variable("switches", "1", words, "output", whole=True))
        rows += [
            Variable(s.name, s.unit, s.meaning, "parameter", 0.0, fixed=True)
            for s, _ in made.starts
        ]
        rows += [
            Variable(p.name, p.unit, p.meaning, "parameter", p.value, p.low, p.high)
            for p in self.parameters
        ]
        return rows

    def _model(self) -> str:
        """The model behind the interface: its variables, start and step."""
        made = self.made
        rows = [
            (*place, len(made.starts) + i)
            for i, parameter in enumerate(self.parameters)
            for place in parameter.places
        ]
        numbers = made.tables.get("numbers", np.zeros(0))
        return self.code.render(
            "model.c.jinja",
            name=made.name,
            moves=made.moves,
            late=bool(made.moves and numbers[axis_step.DELAY] > 0.0),
            dt=made.dt,
            size=numbers.size,
            inputs=made.inputs,
            outputs=made.outputs,
            settings=[v for v in self.variables if v.causality == "parameter"],
            first=1 + len(made.inputs) + len(made.outputs) + made.moves,
            starts=len(made.starts),
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

    def zipped(self) -> bytes:
        """The whole FMU."""
        binary, library = self.built()
        content: dict[str, bytes] = {"modelDescription.xml": self.description().encode("utf-8")}
        content |= {f"sources/{name}": text.encode("utf-8") for name, text in self.files.items()}
        if self.major == "3":
            content["sources/buildDescription.xml"] = self._build_description().encode("utf-8")
        content["documentation/README.md"] = self.code.readme().encode("utf-8")
        content[f"binaries/{binary}"] = library
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in content.items():
                # One date for all: the same object gives the same file.
                entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, data)
        return buffer.getvalue()

    def built(self) -> tuple[str, bytes]:
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
                compiler, "-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-Wall",
                "-Wextra", f"-I{fmi_headers()}", f"fmi{self.major}.c", "-o", name, "-lm",
            ]  # fmt: skip
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
            if done.returncode:
                raise ValueError(
                    f"{compiler} refuses the C of the FMU: {done.stderr.strip()[-600:]}"
                )
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

    def _build_description(self) -> str:
        """sources/buildDescription.xml of version 3."""
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            f'<fmiBuildDescription fmiVersion="{self.version}">\n'
            f'  <BuildConfiguration modelIdentifier="{self.made.name}">\n'
            '    <SourceFileSet language="C99" compilerOptions="-ffp-contract=off">\n'
            f'      <SourceFile name="fmi{self.major}.c"/>\n'
            "    </SourceFileSet>\n"
            "  </BuildConfiguration>\n</fmiBuildDescription>\n"
        )


def _base_unit(unit: str, rotary: bool) -> str:
    """A unit in SI base units."""
    force, length, time = powers(unit)
    if not (force or length or time):
        return ""
    if rotary:
        return ""  # the radian stands for the length: the name alone is safe
    exponents = {"kg": force, "m": force + length, "s": time - 2 * force}
    inner = " ".join(f'{name}="{power}"' for name, power in exponents.items() if power)
    return f"<BaseUnit {inner}/>"


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
