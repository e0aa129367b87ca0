"""Draw what one sees in the data when an effect is missing: ``python docs/make_effects.py``.

Every effect of the catalogue is simulated on one axis in one closed loop. The nominal axis is right
in all else, so that the force residual is what the missing effect leaves behind.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image
from scipy.signal import savgol_filter

import dryfric_control as dfc
from dryfric_control import effects
from dryfric_control.drawing import TIME_LABEL
from dryfric_control.estimation.force_residual import Sliding
from dryfric_control.records.motion import directions

IMAGES = Path(__file__).resolve().parent / "images"
DT, SECONDS, QUANTUM = 1e-3, 24.0, 1e-6
AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
#: The same numbers in rad and N m turn too little to show gravity: a lighter arm.
ROTARY = dfc.FrictionAxis(mass=0.01, viscous=0.1, coulomb=8.0, units=("rad", "N m"))
FORWARDS, BACKWARDS = "C0", "C1"
#: Half height of all panels of force residual [N].
HEIGHT = 6.5
#: Most dots of one panel.
DOTS = 1500


class Seen(NamedTuple):
    """A record and its sliding samples, with the force residual of the nominal axis."""

    record: dfc.Record
    at: Sliding
    residual: NDArray[np.float64]


class View(NamedTuple):
    """Abscissa of a panel: its label and values at the sliding samples."""

    label: str
    of: Callable[[Seen], NDArray[np.float64]]
    limits: tuple[float, float] | None = None
    height: float = HEIGHT


def since_reversal(seen: Seen) -> NDArray[np.float64]:
    """Time since the last change of direction [ms]."""
    moving = directions(seen.record)
    index = np.flatnonzero(moving)
    turned = index[1:][np.diff(moving[index]) != 0]
    last = np.searchsorted(turned, np.rint(seen.at.t / DT).astype(int), side="right") - 1
    time = 1e3 * (seen.at.t - seen.record.t[turned[np.maximum(last, 0)]])
    return np.where(last < 0, np.nan, time)


VELOCITY = View("velocity [mm/s]", lambda seen: 1e3 * seen.at.v)
SLOW = View("velocity, near zero [mm/s]", lambda seen: 1e3 * seen.at.v, (-60.0, 60.0))
POSITION = View("position [mm]", lambda seen: 1e3 * seen.at.x)
ANGLE = View("position [rad]", lambda seen: seen.at.x)
TIME = View(TIME_LABEL, lambda seen: seen.at.t)
ZOOM = View(TIME_LABEL, lambda seen: seen.at.t, (4.0, 7.0))
ACCELERATION = View("acceleration [m/s\u00b2]", lambda seen: seen.at.a)
DRIVE = View("drive force [N]", lambda seen: seen.at.u)
DRIVE_RATE = View(
    "rate of drive force [N/s]",
    lambda seen: savgol_filter(seen.record.u, 17, 3, 1, DT)[np.rint(seen.at.t / DT).astype(int)],
    (-300.0, 300.0),
)
REVERSAL = View("time since reversal [ms]", since_reversal, (0.0, 150.0), 18.0)

#: One of every effect, and the view in which it shows best. None: drawn by `SPECIAL`.
CASES: dict[str, tuple[effects.Effect, View | None]] = {
    effect.slug: (effect, view)
    for effect, view in (
        (effects.ViscousFriction(factor=1.5), POSITION),
        (effects.CoulombFriction(factor=1.35), POSITION),
        (effects.StribeckPeak(excess=0.5, speed=0.015), SLOW),
        (effects.StribeckAsymmetry(difference=0.4, speed=0.015), SLOW),
        (effects.VelocityStrengthening(deficit=0.5, speed=0.03), SLOW),
        (effects.ViscousAsymmetry(viscous=7.0), POSITION),
        (effects.QuadraticDrag(drag=14.0), POSITION),
        (effects.BiasForce(force=3.0), POSITION),
        (effects.CoulombAsymmetry(force=3.0), POSITION),
        (effects.Spring(stiffness=25.0), POSITION),
        (effects.Gravity(amplitude=4.0), ANGLE),
        (effects.Cogging(amplitude=3.0, period=0.06), POSITION),
        (effects.PositionDependence(slope=3.0), POSITION),
        (effects.FrictionRipple(amplitude=0.3, period=0.06), POSITION),
        (effects.PositionForce(middle=0.0, reach=0.12, c1=-2.0, c3=2.5, c4=1.5), POSITION),
        (effects.EndStop(low=-0.09, high=0.09, stiffness=400.0, damping=4.0), POSITION),
        (effects.EccentricEncoder(amplitude=8e-4, period=0.06), POSITION),
        (effects.WarmUp(rise=0.6, time_constant=6.0), TIME),
        (effects.ViscousWarmUp(rise=15.0, time_constant=6.0), TIME),
        (effects.Drift(rate=0.02), TIME),
        (effects.TimePeriodic(amplitude=3.0, frequency=1.5), ZOOM),
        (effects.Inertia(factor=1.4), ACCELERATION),
        (effects.InputGain(gain=0.8), DRIVE),
        (effects.DeadZone(width=2.0), DRIVE),
        (effects.Saturation(limit=15.0), DRIVE),
        (effects.LoadDependence(coefficient=0.2), DRIVE),
        (effects.LoadAsymmetry(coefficient=0.2), DRIVE),
        (effects.InputDelay(delay=0.008), DRIVE_RATE),
        (effects.ActuatorLag(time_constant=0.008), DRIVE_RATE),
        (effects.Presliding(distance=2e-5), None),
        (effects.DwellTime(rise=4.0, time_constant=0.8), None),
        (effects.LoadEncoderBacklash(gap=2e-3, load_fraction=0.4), None),
        (effects.Backlash(gap=2e-3, load_fraction=0.4), REVERSAL),
        (effects.Compliance(stiffness=8e3, damping=4.0, load_fraction=0.4), REVERSAL),
    )
}


def reference() -> NDArray[np.float64]:
    """Fast moves, a slow crawl, and rests between: the motion of every record [m]."""
    t = DT * np.arange(round(SECONDS / DT))
    way = 0.08 * np.sin(2.0 * np.pi * 0.35 * t) + 0.03 * np.sin(2.0 * np.pi * 1.3 * t)
    crawl = 0.01 * np.sin(2.0 * np.pi * 0.25 * t)
    slow = np.clip(np.minimum(t - 9.0, 15.0 - t), 0.0, 1.0)
    return np.asarray((1.0 - slow) * way + slow * crawl)


def seen_of(effect: effects.Effect) -> Seen:
    """The record of an axis with an effect, held against the axis without it."""
    rotary = isinstance(effect, effects.Gravity)
    axis = ROTARY if rotary else AXIS
    loop = dfc.PositionController.from_bandwidth(axis, bandwidth=25.0, dt=DT)
    way = reference() * (25.0 if rotary else 1.0)
    run = dfc.simulate_loop(axis.replace(effects=(effect,)), loop, way, quantum=QUANTUM)
    record = dfc.Record(
        t=run.t, u=run.y[4], x=run.y[5], units=dict(zip("xu", axis.units, strict=True))
    )
    # Impacts and ringing are short; the others show clearer behind more smoothing.
    at = Sliding(record, smoothing=7 if CASES[effect.slug][1] is REVERSAL else 17)
    return Seen(record, at, at.force_residual(axis))


def draw(ax: Any, seen: Seen, view: View) -> None:
    """Force residual over one abscissa, a colour for each direction."""
    abscissa = view.of(seen)
    low, high = view.limits or (np.nanmin(abscissa), np.nanmax(abscissa))
    inside = np.flatnonzero((abscissa >= low) & (abscissa <= high))
    inside = inside[:: max(1, inside.size // DOTS)]
    for way, colour in ((1, FORWARDS), (-1, BACKWARDS)):
        pick = inside[seen.at.direction[inside] == way]
        ax.plot(abscissa[pick], seen.residual[pick], ".", color=colour, ms=1.8, mew=0)
    ax.axhline(0.0, color="0.3", lw=0.7, zorder=0)
    room = 0.03 * (high - low)
    ax.set(xlabel=view.label, xlim=(low - room, high + room), ylim=(-view.height, view.height))


def draw_presliding(ax: Any) -> None:
    """Position over drive below breakaway: elastic, where the nominal axis stands still."""
    t = DT * np.arange(6000)
    u = 7.0 * np.sin(2.0 * np.pi * 0.5 * t) * np.minimum(t / 3.0, 1.0)
    run = AXIS.replace(effects=(CASES["presliding"][0],)).simulate(u, dt=DT)
    ax.plot(u, 1e6 * run.y[0], color=FORWARDS, lw=1.2)
    ax.axhline(0.0, color="0.3", lw=0.7, zorder=0)
    ax.set(xlabel="drive force, axis at rest [N]", ylabel="position [\u00b5m]")


def draw_dwell(ax: Any) -> None:
    """Drive force at breakaway over the time at rest before it."""
    rests = 0.1 * 1.45 ** np.arange(10)
    pulse = np.interp(DT * np.arange(500), [0.0, 0.3, 0.35, 0.5], [0.0, 15.0, 0.0, 0.0])
    parts = [part for rest in rests for part in (np.zeros(round(rest / DT)), pulse)]
    run = AXIS.replace(effects=(CASES["dwell_time"][0],)).simulate(
        np.concatenate([pulse, *parts]), dt=DT
    )
    stopped = run.events.times(before=1, after=0)
    started = run.events.times(before=0, after=1)
    force = np.interp(started, run.t, np.concatenate([pulse, *parts]))
    rested = [start - stopped[stopped < start].max() for start in started[1:]]
    ax.plot(rested, force[1:], "o", color=FORWARDS, ms=3)
    ax.axhline(8.0, color="0.3", lw=0.7, zorder=0)
    ax.set(xlabel="time at rest before [s]", ylabel="breakaway force [N]", ylim=(6.0, 13.0))


def draw_load_encoder(ax: Any) -> None:
    """Velocity at one reversal, and that of the nominal axis driven by the same force."""
    record = seen_of(CASES["load_encoder_backlash"][0]).record
    moving = directions(record)
    index = np.flatnonzero(moving)
    start = int(index[1:][np.diff(moving[index]) != 0][4])
    part = slice(start - 120, start + 180)
    time, v = 1e3 * (record.t[part] - record.t[start]), record.derivatives(7).v
    nominal = AXIS.simulate(record.u[part], dt=DT, x0=record.x[part.start], v0=v[part.start]).y[1]
    for way, colour in ((1, FORWARDS), (-1, BACKWARDS)):
        there = np.sign(np.round(v[part], 3)) == way
        ax.plot(time[there], 1e3 * v[part][there], ".", color=colour, ms=2.5, mew=0)
    ax.plot(time, 1e3 * nominal, color="0.3", lw=0.9)
    ax.set(xlabel="time from a reversal [ms]", ylabel="velocity [mm/s]")


SPECIAL = {
    "presliding": draw_presliding,
    "dwell_time": draw_dwell,
    "load_encoder_backlash": draw_load_encoder,
}


def residual_label(slug: str) -> str:
    """Label of the force residual, of a torque on the rotary axis."""
    return "torque residual [N\u00b7m]" if slug == "gravity" else "force residual [N]"


def thumbnail(slug: str, seen: Seen) -> plt.Figure:
    """Force residual over velocity, and the view in which the effect shows best."""
    view = CASES[slug][1]
    figure, (left, right) = plt.subplots(1, 2, figsize=(5.0, 1.75), layout="constrained")
    rotary = slug == "gravity"
    draw(left, seen, View("velocity [rad/s]", lambda one: one.at.v) if rotary else VELOCITY)
    left.set_ylabel(residual_label(slug))
    if view is None:
        SPECIAL[slug](right)
    else:
        draw(right, seen, view)
        right.tick_params(labelleft=view.height != HEIGHT)
    return figure


def overview(all_seen: dict[str, Seen]) -> plt.Figure:
    """The best view of every effect, one beside the other."""
    rows = -(-len(CASES) // 5)
    figure, axes = plt.subplots(rows, 5, figsize=(10.0, 1.75 * rows), layout="constrained")
    figure.get_layout_engine().set(rect=(0.0, 0.0, 0.99, 1.0))  # room for the last tick
    beside: tuple[str, float] | None = None
    for ax, (slug, (effect, view)) in zip(axes.ravel(), CASES.items(), strict=False):
        scale = None if view is None else (residual_label(slug), view.height)
        if view is None:
            SPECIAL[slug](ax)
        else:
            # What velocity shows by itself is drawn over velocity.
            draw(ax, all_seen[slug], VELOCITY if slug in OVER_VELOCITY else view)
            # Panels side by side share what they have alike.
            if ax.get_subplotspec().is_first_col() or scale != beside:
                ax.set_ylabel(residual_label(slug))
            else:
                ax.tick_params(labelleft=False)
        beside = scale
        title = effect.title[0].upper() + effect.title[1:]
        ax.set_title(textwrap.fill(title, 24), fontsize=8.5)
    for ax in axes.ravel()[len(CASES) :]:
        ax.set_axis_off()
    marks = [
        Line2D([], [], linestyle="", marker=".", color=FORWARDS, label="forwards"),
        Line2D([], [], linestyle="", marker=".", color=BACKWARDS, label="backwards"),
        Line2D([], [], color="0.3", lw=0.7, label="nominal model"),
    ]
    figure.legend(handles=marks, loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    return figure


#: Effects that over velocity show all there is.
OVER_VELOCITY = (
    "viscous", "coulomb", "viscous_asymmetry", "quadratic_drag", "bias_force", "coulomb_asymmetry",
)  # fmt: skip


def save(figure: plt.Figure, path: Path, dpi: int) -> None:
    """A PNG of few colours, which is all that dots and lines need."""
    figure.savefig(path, dpi=dpi)
    plt.close(figure)
    with Image.open(path) as image:
        few = image.convert("RGB").quantize(32, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def main() -> None:
    folder = IMAGES / "effects"
    folder.mkdir(parents=True, exist_ok=True)
    plt.rcParams.update({"font.size": 8.0, "axes.spines.top": False, "axes.spines.right": False})
    seen = {slug: seen_of(effect) for slug, (effect, _) in CASES.items()}
    for slug, one in seen.items():
        save(thumbnail(slug, one), folder / f"{slug}.png", dpi=120)
        print(f"{slug}: force residual {np.sqrt(np.mean(one.residual**2)):.2f} N RMS")
    save(overview(seen), IMAGES / "effects.png", dpi=110)


if __name__ == "__main__":
    main()
