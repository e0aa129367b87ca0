"""The demo: fit, replay, the figures of the paper, a diagnosis."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import control as ct
import matplotlib.pyplot as plt
import numpy as np

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.diagnosis.report.diagnosis import write_report
from dryfric_control.drawing import MEASURED, legend_above, title_above
from dryfric_control.identification import CoulombIdentification, SlowRamp
from dryfric_control.store.files import output_folder, replace_file, write_file
from dryfric_control.text import length_text, percent

#: What it does and how long that takes, as measured for the README.
ABOUT = (
    "Four parts: stick-slip, a fit with its replay, the figures of the paper, a diagnosis. About "
    "21 s of a core; the first time, while code is compiled for later runs too, 123 s."
)
#: Part of the record that is fitted; the rest is held out.
TRAINING = 0.6
#: Fig. 3 of the paper: the actuator above its closed loop, drawn by ``docs/make_theory.py``.
SYSTEM = Path(__file__).with_name("figure_3_system.png")
_FREE = ("mass", "viscous", "coulomb", "bias_force")


def emps_controller(dt: float) -> dfc.PositionController:
    """Controller that ran while the EMPS record was taken."""
    # From its reference: vir = kp kv (qg - qm) - kv dq, dq the backward difference of the
    # two-sample mean, saturation 10 V, 35.15 N/V (A. Janot, M. Gautier, M. Brunot, Nonlinear
    # System Identification Benchmarks, 2019).
    kp = 160.18
    kv = 243.45
    gain = 35.15
    return dfc.PositionController(gain * kp * kv, 0.0, gain * kv, dt, limit=gain * 10.0, span=2)


def stick_slip() -> ct.ControlPlot:
    """Classic stick-slip: a mass pulled by a spring whose end moves slowly."""
    spring = dfc.effects.Spring(stiffness=2.0)
    peak = dfc.Stribeck(excess=0.5, speed=0.05)
    axis = dfc.FrictionAxis(1.0, 0.0, dfc.CoulombMap.of(1.0), peak, 1e-3, effects=(spring,))
    axis = axis.replace(name="mass pulled by a spring")
    t = np.arange(40_001) * 1e-3
    return axis.simulate(spring.stiffness * 0.1 * t, dt=1e-3, hold="first").plot()


def made_record() -> tuple[dfc.FrictionAxis, dfc.Record, dfc.PositionController]:
    """Nominal axis (every parameter is off), simulated record of 20 s, its controller."""
    levels = dfc.CoulombMap.of((9.0, 7.0))
    true = dfc.FrictionAxis(12.0, 60.0, levels, travel=(0.0, 0.3), name="simulated axis")
    dt = 1e-3
    n = 20_000
    t = np.arange(n) * dt
    steps = np.repeat(np.random.default_rng(0).uniform(0.05, 0.25, 20), n // 20)
    slow = 0.15 + 0.08 * np.sin(2.0 * np.pi * t / 8.0)
    reference = np.where(t < 10.0, slow, np.convolve(steps, np.ones(200) / 200.0, "same"))
    controller = dfc.PositionController(kp=8000.0, ki=0.0, kd=500.0, dt=dt, limit=200.0)
    run = dfc.simulate_loop(true, controller, reference, quantum=2e-6, x0=0.15)
    record = dfc.Record(t=t, u=run.y[4], x=run.y[5], reference=reference, name="simulated record")
    believed = true.replace(mass=9.0, viscous=90.0, coulomb=dfc.CoulombMap.of(6.0))
    return believed, record, controller


def measured_record(
    path: str | os.PathLike[str], dt: float | None = None
) -> tuple[dfc.FrictionAxis, dfc.Record, dfc.PositionController | None]:
    """A rough axis for a measured record, the record, its controller where that is known."""
    record = dfc.read_record(path, dt=dt)
    axis = dfc.FrictionAxis(50.0, 100.0, dfc.CoulombMap.of(10.0), name=record.name or "axis")
    is_emps = Path(path).name.upper().startswith("DATA_EMPS")
    return axis, record, emps_controller(record.dt) if is_emps else None


def fit_and_replay(
    axis: dfc.FrictionAxis, record: dfc.Record, controller: dfc.PositionController | None
) -> tuple[dfc.Fit, dict[str, Any], dict[str, ct.ControlPlot]]:
    """Fit the first part of a record, replay the rest: the fit, its figures in numbers, plots."""
    training, held_out = record.split(TRAINING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dfc.FitWarning)  # its messages are in the summary
        fitted = dfc.fit(axis, training, free=_FREE)
    before = dfc.replay(axis, held_out)
    after = dfc.replay(fitted.axis, held_out)
    level = fitted.parameters["coulomb"]
    bias = fitted.parameters["bias_force.force"]
    summary: dict[str, Any] = {
        "record": record.name,
        "trained_until_s": float(training.t[-1]),
        "parameters": fitted.parameters,
        "standard_errors": fitted.standard_errors,
        # One level and an offset are two levels: no record separates them.
        "coulomb_plus": level - bias,
        "coulomb_minus": level + bias,
        "held_out_windows": {
            "window_s": 0.25,
            "position_rms_before_m": before.rms,
            "position_rms_after_m": after.rms,
            "position_median_after_m": after.median,
        },
    }
    figures = {"fit": fitted.plot(), "held_out_windows": after.plot()}
    if controller is not None and record.reference is not None:
        loop = dfc.replay_loop(fitted.axis, held_out, controller)
        summary["held_out_closed_loop"] = loop.to_dict()
        figures["held_out_closed_loop"] = loop.plot()
    return fitted, summary, figures


def paper_results(say: Callable[[str], None]) -> tuple[dict[str, Any], dict[str, ct.ControlPlot]]:
    """The paper's sections 2, 3 (on a simulated bench) and 5: numbers, Figures 1 to 11."""
    say("3/4 The paper's figures: 1 to 3, friction, state machine, actuator and closed loop")
    axis = presets.clutch_actuator()
    figures = {
        "figure_1_friction": marked_friction(axis),
        "figure_2_state_machine": dfc.plot_state_machine(axis),
    }
    say("    4 to 6, slow ramp on a simulated bench: levels, then the excess of the Stribeck peak")
    ramp = dfc.slow_ramp_experiment(axis, dt=2e-3, quantum=presets.QUANTUM)
    # Mass and viscous friction are known, vs is Sigma (paper).  The way forwards gives the excess,
    # and its levels again, whose error would be one of the excess.
    believed = axis.replace(stribeck=dfc.Stribeck(excess=0.1, speed=axis.stick_speed))
    levels = dfc.identify_coulomb(ramp.record, axis=believed)
    free = ("stribeck.excess", *(f"coulomb_plus[{i}]" for i in range(len(levels.plus))))
    forwards = ramp.record[: len(ramp.record) // 2]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dfc.FitWarning)  # its messages are printed with the result
        peak = dfc.identify_stribeck(
            levels.apply(believed), forwards, ramp.controller, free=free, starts=1
        )
    say(peak.summary())
    say("    7 to 11, switched PI observer in closed loop")
    loop = presets.clutch_experiment()
    figures |= {
        "figure_4_slow_ramp": ramp.plot(),
        "figure_5_coulomb": over_crawl(levels, ramp),
        "figure_6_stick_slip": peak.plot(),
        "figure_7_maps": loop.plot(what="maps"),
        "figure_8_position": loop.plot(what="position"),
        "figure_9_speed": loop.plot(what="speed"),
        "figure_10_friction": loop.plot(what="friction"),
        "figure_11_modes": loop.plot(what="mode"),
    }
    summary = {
        "bench": {"coulomb": levels.to_dict(), "stick_slip": peak.to_dict()},
        "observer": {"design": loop.design.certificate.to_dict(), "loop": loop.to_dict()},
    }
    return summary, figures


def marked_friction(axis: dfc.FrictionAxis) -> ct.ControlPlot:
    """Friction over velocity with Fs, Fc and Sigma (Fig. 1)."""
    drawn = axis.plot_friction()
    one = drawn.axes[0, 0]
    places = np.mean(axis.travel or (0.0, 0.0))
    breakaway = axis.breakaway(places, 1)
    level = axis.coulomb(places, 1)
    left = one.get_xlim()[0]
    sigma = axis.stick_speed
    for force, name in ((breakaway, r"$F_s$"), (level, r"$F_c$")):
        one.plot([left, 0.0], [force, force], ":", color="0.3", lw=1.0)
        one.text(0.96 * left, force, name, va="bottom", ha="left")
    for s, name in ((-1, r"$-\Sigma$"), (1, r"$\Sigma$")):
        low = -axis.breakaway(places, -1) if s < 0 else breakaway
        one.plot([s * sigma, s * sigma], [0.0, low], ":", color="0.3", lw=1.0)
        one.text(s * sigma, 0.0, name, va="bottom" if s < 0 else "top", ha="center")
    return drawn


def over_crawl(levels: CoulombIdentification, ramp: SlowRamp) -> ct.ControlPlot:
    """Levels found over the crawl as recorded, and those of the simulated bench (Fig. 5)."""
    drawn = levels.plot(title="Coulomb level over the travel: crawl, levels found, truth")
    one = drawn.axes[0, 0]
    record = ramp.record
    some = slice(None, None, max(1, len(record) // 10_000))
    crawl = {"color": MEASURED, "lw": 0.8, "zorder": 0, "label": "crawl, measured"}
    one.plot(record.x[some], record.u[some], "--", **crawl)
    x = np.linspace(*levels.travel, 201)
    for s in (1, -1):
        truth = s * ramp.axis.coulomb(x, s)
        one.plot(x, truth, "k:", lw=1.2, label="truth" if s > 0 else None)
    one.set_xlabel(f"position [{ramp.axis.units[0]}]")
    legend_above(one)
    title_above(one, one.get_title(loc="left"))
    return drawn


def hidden_cause() -> dfc.Diagnosis:
    """Diagnosis of a short record of an axis with a Stribeck peak that the model lacks."""
    axis = dfc.FrictionAxis(2.0, 15.0, dfc.CoulombMap.of(8.0), name="simulated stage")
    machine = axis.replace(stribeck=dfc.Stribeck(excess=0.4, speed=0.03))
    t = 2e-3 * np.arange(3000)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=2e-3).y[0])
    return dfc.diagnose(axis, dfc.Record(t, u, x, name="simulated record of 6 s"), progress=False)


def run(
    out: str | os.PathLike[str],
    record_path: str | os.PathLike[str] | None = None,
    say: Callable[[str], None] = print,
    dt: float | None = None,
) -> dict[str, Any]:
    """Run the demo: figures and a summary into a folder; without a record, of a simulated one."""
    axis, record, controller = (
        made_record() if record_path is None else measured_record(record_path, dt)
    )
    folder = output_folder(out)
    say(ABOUT)
    say("1/4 Stick-slip of a mass pulled by a spring: stick_slip.png")
    save(stick_slip(), folder / "stick_slip.png")

    fitted, summary, figures = fit_and_replay(axis, record, controller)
    say(f"2/4 Fit of {record.name or 'the record'}, first {TRAINING:.0%}:")
    say(fitted.summary())
    say(
        f"Coulomb level and bias force together: {summary['coulomb_plus']:.4g} N "
        f"forwards, {summary['coulomb_minus']:.4g} N backwards"
    )
    windows = summary["held_out_windows"]
    say(
        "Held-out data, free runs of 0.25 s: position error "
        f"{length_text(windows['position_rms_before_m'], 'm')} RMS before the fit, "
        f"{length_text(windows['position_rms_after_m'], 'm')} after "
        f"(median window {length_text(windows['position_median_after_m'], 'm')})"
    )
    if "held_out_closed_loop" in summary:
        loop = summary["held_out_closed_loop"]
        say(
            f"Held-out data, closed loop: position error {length_text(loop['position_rms'], 'm')} "
            f"RMS, force error {loop['force_rms']:.3g} N RMS ({percent(loop['relative_force'])} "
            "of the drive force)"
        )
    numbers, drawn = paper_results(say)
    summary |= numbers
    write_file(folder / SYSTEM.name, SYSTEM.read_bytes())
    for name, figure in (figures | drawn).items():
        save(figure, folder / f"{name}.png")

    say("4/4 Diagnosis of a simulated axis with an unmodelled Stribeck peak: report.html")
    found = hidden_cause()
    say(found.summary())
    write_report(found, folder)
    summary["diagnosis"] = found.to_dict()

    write_file(folder / "summary.json", json.dumps(summary, indent=2) + "\n")
    say(f"report.html, the figures and summary.json are in {folder}")
    return summary


def save(figure: ct.ControlPlot, path: Path) -> None:
    """Write a figure as PNG, whole or not at all, and close it."""
    with replace_file(path) as temporary:
        figure.figure.savefig(temporary, dpi=110, format="png")
    plt.close(figure.figure)
