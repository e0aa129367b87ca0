"""Model files: read whole, written whole, numbers as text."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from dryfric_control.checks import file_path
from dryfric_control.diagnosis.report.diagnosis import load_diagnosis
from dryfric_control.identification import load_fit
from dryfric_control.simulators.joint_values import SimulatorValues
from dryfric_control.store.files import existing_file, replacing
from dryfric_control.store.saved import load_any


def read_model(model: Any, out: Any) -> tuple[Path, bytes, Path]:
    """Path and bytes of a model file, and where to write it."""
    path = existing_file(file_path("model", model))
    return path, path.read_bytes(), path if out is None else file_path("out", out)


def written(found: SimulatorValues, path: Path, content: bytes) -> SimulatorValues:
    """The values, once the file is there."""
    with replacing(path) as part:
        part.write_bytes(content)
    return replace(found, files=(path,))


class Edit(NamedTuple):
    """Bytes that take the place of others."""

    begin: int
    end: int
    new: bytes


def applied(raw: bytes, edits: Iterable[Edit]) -> bytes:
    """The file with all edits, which do not overlap."""
    for edit in sorted(edits, reverse=True):
        raw = raw[: edit.begin] + edit.new + raw[edit.end :]
    return raw


def number(value: float) -> str:
    """A number with six digits, as every format reads it."""
    return f"{value:.6g}"


def read_result(path: str | os.PathLike[str]) -> Any:
    """A fit, a diagnosis or an axis, whichever a file holds."""
    return load_any(
        path,
        {"fit": load_fit, "diagnosis": load_diagnosis},
        "is no result: give an axis (TOML), or what `save` wrote of a fit or a diagnosis (JSON; "
        "saved.json of the command diagnose)",
    )
