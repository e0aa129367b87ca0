"""Draw the figures of the documentation: ``python docs/make_figures.py``."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import control as ct
import matplotlib.pyplot as plt
import numpy as np

import dryfric_control as dfc
from dryfric_control import presets
from dryfric_control.demo import save
from dryfric_control.drawing import TIME_LABEL, title_above
from dryfric_control.estimation.force_residual import Sliding
from dryfric_control.estimation.likelihood import Likelihood, prepare
from dryfric_control.estimation.scoring import maximise

IMAGES = Path(__file__).resolve().parent / "images"
NAMES = {0: "stuck", 1: "sliding"}
STYLES = {0: ("0.5", "-"), 1: ("C0", "-")}


def bode_and_step(
    systems: dict[int, ct.StateSpace], title: str, y: str, unit: str
) -> ct.ControlPlot:
    """Bode and step plot of one system for each mode, side by side."""
    figure, axes = plt.subplot_mosaic("ms;ps", figsize=(8.0, 3.8), layout="constrained")
    magnitude, phase, step = axes["m"], axes["p"], axes["s"]
    for mode, system in systems.items():
        colour, line = STYLES[mode]
        omega = np.logspace(0.0, np.log10(0.95 * np.pi / system.dt), 400)
        response = np.ravel(system(np.exp(1j * omega * system.dt)))
        magnitude.loglog(omega, np.abs(response), color=colour, linestyle=line, label=NAMES[mode])
        phase.semilogx(omega, np.degrees(np.unwrap(np.angle(response))), color=colour)
        moved = ct.step_response(system, T=np.arange(200) * system.dt)
        step.plot(1e3 * moved.t, np.ravel(moved.y), color=colour, label=NAMES[mode])
    magnitude.set(title=title, ylabel=f"magnitude\n[{unit}]")
    phase.set(xlabel="Frequency [rad/s]", ylabel="phase [deg]")
    step.set(title="step", xlabel="Time [ms]", ylabel=y)
    step.legend(frameon=False)
    return ct.ControlPlot(np.array(figure.axes), np.array([magnitude, phase, step]), figure)


def modes() -> ct.ControlPlot:
    """From an unknown force to the position, mode by mode."""
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    systems = {mode: axis.mode_ss(mode, dt=1e-3, input="force") for mode in (0, 1)}
    return bode_and_step(systems, "force to position", "position [m]", "m/N")


def error_dynamics(output: str, through: float, title: str, y: str, unit: str) -> ct.ControlPlot:
    """From a force uncertainty to an error of the clutch observer."""
    design = presets.clutch_observer()
    systems = {}
    for mode in (0, 1):
        full = design.error_dynamics(mode)
        row, column = full.output_labels.index(output), full.input_labels.index("force")
        part = ct.ss(full.A, full.B[:, [column]], full.C[[row]], [[through]], full.dt)
        systems[mode] = part
    return bode_and_step(systems, title, y, unit)


def tutorial() -> None:
    """What the code of `tutorial.md` draws."""
    axis = dfc.FrictionAxis(
        mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(excess=0.3, speed=0.01)
    )
    save(dfc.plot_state_machine(axis), IMAGES / "state_machine.png")
    pushed = axis.simulate(12 * np.sin(3 * np.arange(3000) * 1e-3), dt=1e-3)
    save(pushed.plot(title="pushed by a sine"), IMAGES / "pushed.png")
    nominal = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = nominal.replace(effects=(dfc.effects.Spring(stiffness=40.0, rest=0.05),))
    t = np.arange(10000) * 1e-3
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    save(dfc.diagnose(nominal, dfc.Record(t=t, u=u, x=x)).plot(), IMAGES / "diagnosed.png")


def force_first() -> None:
    """The three views of a diagnosis of the record that ships, nominal and with its causes."""
    record = dfc.datasets.belt_stage()
    axis = dfc.FrictionAxis(mass=2.4, viscous=12.0, coulomb=9.0)
    sides = {"nominal axis": axis, "with its causes": dfc.diagnose(axis, record).extended}
    figure, axes = plt.subplots(5, 2, figsize=(8.0, 8.5), sharey=True, layout="constrained")
    for column, (name, one) in zip(axes.T, sides.items(), strict=True):
        lacks = record.force_map(one)
        lacks.draw(column)
        title_above(column[0], f"{name}: {lacks.rms:.2g} N RMS missing")
    for one in axes[:, 1]:
        one.set_ylabel("")
    figure.savefig(IMAGES / "force_map.png", dpi=110)
    run = prepare(record, mass=axis.mass)
    figure, rows = plt.subplots(2, 1, figsize=(7.0, 3.6), sharex=True, layout="constrained")
    for row, (name, one) in zip(rows, sides.items(), strict=True):
        # The noises that are the likeliest with this axis, found by a fit of nothing else.
        fit = maximise(Likelihood(one.effective(), (), [run]), np.log([1.0, 1e-12]))
        (out,) = fit.point.out
        row.plot(record.t, out[0] / np.sqrt(np.maximum(out[1], 1e-300)), "C0.", ms=1.5)
        row.axhspan(-2.0, 2.0, color="0.9", lw=0, zorder=0)
        row.set(ylabel="innovation\n[standard dev.]", ylim=(-8.0, 8.0))
        row.set_title(f"{name}: random force {fit.random_force():.2g} N", loc="left")
    rows[-1].set_xlabel(TIME_LABEL)
    figure.savefig(IMAGES / "likelihood.png", dpi=110)


def invariants() -> None:
    """Forces of a regression in which two cancel, beside those of an axis with its causes."""
    nominal = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
    machine = nominal.replace(effects=(dfc.effects.Cogging(amplitude=3.0, period=0.3),))
    t = np.arange(10000) * 1e-3
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = 1e-6 * np.round(1e6 * machine.simulate(u, dt=1e-3).y[0])
    record = dfc.Record(t, u, x)
    extended = dfc.diagnose(nominal, record).extended
    slide = Sliding(record)
    drive, inertia = np.abs(slide.u).max(), extended.mass * np.abs(slide.a).max()
    bare = extended.replace(effects=(), viscous=0.0, coulomb=0.0, stribeck=None)
    angle = 2.0 * np.pi * slide.x / (20.0 * np.ptp(slide.x))
    columns = {
        "inertia": slide.a,
        "viscous": slide.v,
        "Coulomb": slide.direction,
        "weight": np.ones_like(slide.x),
        "cogging, 20 travels": np.column_stack((np.sin(angle), np.cos(angle))),
    }
    everything = np.column_stack(tuple(columns.values()))
    amounts = np.linalg.lstsq(everything, slide.u, rcond=None)[0]
    parts = np.split(amounts, np.cumsum([np.ndim(c) for c in columns.values()])[:-1])
    regression = {
        name: np.abs(column @ part if column.ndim > 1 else column * part).max()
        for (name, column), part in zip(columns.items(), parts, strict=True)
    }
    alone = {
        "viscous": bare.replace(viscous=extended.viscous),
        "Coulomb": bare.replace(coulomb=extended.coulomb),
        **{one.title: bare.replace(effects=(one,)) for one in extended.effects},
    }
    without = slide.force_residual(bare)
    answer = {"inertia": inertia} | {
        name: np.abs(slide.force_residual(axis) - without).max() for name, axis in alone.items()
    }
    figure, axes = plt.subplots(1, 2, sharex=True, figsize=(8.0, 2.6), layout="constrained")
    for row, (name, forces) in zip(
        axes, {"regression": regression, "diagnosis": answer}.items(), strict=True
    ):
        row.barh(list(forces), list(forces.values()), color="C0")
        row.axvline(max(drive, inertia), color="k", lw=0.8, ls="--", label="largest in the record")
        row.invert_yaxis()
        row.set_xlabel("largest force [N]")
        row.set_title(name, loc="left")
    axes[1].legend(loc="lower right", fontsize="small", frameon=False)
    figure.savefig(IMAGES / "invariants.png", dpi=110)


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    save(modes(), IMAGES / "modes.png")
    speed = error_dynamics(
        "e_v",
        0.0,
        "friction-model error to velocity error",
        "velocity error [inc/s]",
        "inc/s per N·m",
    )
    save(speed, IMAGES / "error_speed.png")
    # Estimated minus true friction is the map's error plus e_w.
    friction = error_dynamics(
        "e_w", 1.0, "friction-model error to friction error", "friction error [N·m]", "1"
    )
    save(friction, IMAGES / "error_friction.png")
    run = presets.clutch_experiment()
    save(run.plot(), IMAGES / "observer_loop.png")
    tutorial()
    force_first()
    invariants()


if __name__ == "__main__":
    main()
