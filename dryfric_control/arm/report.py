"""The page on an arm: its model, a table of its joints, friction and torque of each."""

from __future__ import annotations

import base64
import io
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
from markupsafe import Markup

from dryfric_control._version import __version__
from dryfric_control.diagnosis.report.wording import cause_names
from dryfric_control.drawing import MEASURED, TIME_LABEL, label_axes, legend_above
from dryfric_control.estimation.force_residual import Sliding
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.friction_curve import draw_curve
from dryfric_control.records.record import Record
from dryfric_control.store.files import write_file
from dryfric_control.text import table, typeset_signs

if TYPE_CHECKING:
    from dryfric_control.arm.diagnose_arm import ArmDiagnoses

# Samples of a joint that are drawn.
_SHOWN = 2000
# Width and height of a picture [in].
_SIZE = (10.0, 3.4)
# Dots per inch of it.
_DPI = 110
_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("dryfric_control.arm", "."),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_page(found: ArmDiagnoses, path: str | os.PathLike[str]) -> Path:
    """Write the page on an arm, which stands alone."""
    write_file(path, lambda: _page(found))
    return Path(path)


def _page(found: ArmDiagnoses) -> str:
    """The page as text."""
    pictures = {joint: joint_figure(found, joint) for joint in found}
    shown = [
        Markup(table(part, as_html=True)) if isinstance(part, list) else typeset_signs(part)
        for part in found._summary_parts()
    ]
    page = _TEMPLATES.get_template("page.html")
    return page.render(
        shown=shown, found=found, pictures=pictures, cause_names=cause_names, version=__version__
    )


def joint_figure(found: ArmDiagnoses, joint: str) -> str:
    """Friction over velocity, and torque over time, of a joint, as a PNG in base64."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 3))
    draw_joint(found, joint, left, right)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def draw_joint(found: ArmDiagnoses, joint: str, left: Any, right: Any) -> None:
    """Draw friction over velocity, and the drive as measured and as two models need it."""
    nominal = found.nominal[joint]
    axis = found[joint].extended
    # With the load as the joint itself shows it.
    record = found[joint].record
    length, force = axis.units
    sliding = Sliding(record, _SHOWN)
    bare = axis.replace(coulomb=0.0, viscous=0.0, stribeck=None, effects=())
    left.plot(sliding.v, -sliding.force_residual(bare), ".", color=MEASURED, ms=2, label="measured")
    fast = float(np.abs(sliding.v).max())
    span = (float(record.x.min()), float(record.x.max()))
    plain = axis.replace(effects=())
    draw_curve(nominal[0], left, fast, span, "nominal", color="C0", ls="--", lw=1.0)
    draw_curve(plain, left, fast, span, "with the causes", color="k", lw=1.2)
    # Signed numbers with two decimals are wide.
    left.locator_params(axis="x", nbins=5)
    label_axes(left, f"velocity [{length}/s]", typeset_signs(f"friction [{force}]"))
    right.plot(sliding.t, sliding.u, ".", color=MEASURED, ms=2, label="measured")
    right.plot(*_required_drive(*nominal), "C0--", lw=0.8, label="needed by the model")
    right.plot(*_required_drive(axis, record), "k-", lw=0.8, label="with the causes")
    label_axes(right, TIME_LABEL, typeset_signs(f"drive [{force}]"))
    legend_above(right)


def _required_drive(axis: FrictionAxis, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Times, and drive that an axis needs for the motion of a record while it slides."""
    one = Sliding(record, _SHOWN)
    drive = one.u + one.force_residual(axis) / one.answer_to_drive(axis)
    # A gap in the curve where it does not slide.
    step = 3.0 * float(np.median(np.diff(one.t)))
    drive[1:][np.diff(one.t) > step] = np.nan
    return one.t, drive
