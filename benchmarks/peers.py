"""What other free software makes of the same records: parameters, errors, causes, time.

    python benchmarks/peers.py [--cases plain noise hidden] [--only ours scipy]

A slide is simulated here by a switched Coulomb law in steps of 2 us, which shares no code with
the package.  From the first 60 % of each record, and from values that are 30 % off, every peer
finds mass, viscous coefficient and Coulomb level.  The error of prediction is the median over free
runs of 0.25 s over the other 40 %, of an axis with the found values.  Times are of a core, code
compiled.

pysindy and mujoco.sysid run where they are installed:  pip install pysindy "mujoco[sysid]"
"""

from __future__ import annotations

import contextlib
import io
import logging
import math
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import control as ct
import numpy as np
from harness import parser_of
from numba import njit
from scipy.optimize import OptimizeResult, least_squares
from scipy.signal import savgol_filter

import dryfric_control as dfc

MASS = 2.0  # [kg]
VISCOUS = 15.0  # [N s/m]
COULOMB = 8.0  # [N]
COGGING = 1.2  # amplitude of what the model does not have [N]
PITCH = 8e-3  # of it [m]
DT = 1e-3  # [s]
SUBSTEPS = 500  # of a sample
SAMPLES = 10_000
PART = 0.6  # of a record that is fitted
WINDOW = 250  # samples of a free run
START = np.array([1.3 * MASS, 0.7 * VISCOUS, 1.3 * COULOMB])
TRUE = np.array([MASS, VISCOUS, COULOMB])

#: Noise of the recorded drive [N], increment of the encoder [m], cogging [N].
CASES = {
    "plain": (0.0, 1e-6, 0.0),
    "noise": (0.4, 5e-6, 0.0),
    "hidden": (0.4, 5e-6, COGGING),
}


@dataclass(frozen=True)
class Found:
    """What a peer gives: values in the order of TRUE, their standard errors, an axis, a cause."""

    values: np.ndarray
    errors: np.ndarray | None = None
    cause: str = ""
    axis: dfc.FrictionAxis | None = None


@njit(cache=True)
def machine(u, dt, substeps, mass, viscous, coulomb, cogging, pitch, x, v):
    """Position and velocity at the samples, by Euler's steps that stop at a reversal."""
    h, out = dt / substeps, np.empty((2, u.size))
    for k in range(u.size):
        out[0, k], out[1, k] = x, v
        for _ in range(substeps):
            w = u[k] - viscous * v + cogging * math.sin(2.0 * math.pi * x / pitch)
            if v == 0.0 and abs(w) <= coulomb:
                continue
            s = math.copysign(1.0, v if v != 0.0 else w)
            after = v + h * (w - s * coulomb) / mass
            after = 0.0 if after * s < 0.0 else after
            x += 0.5 * h * (v + after)
            v = after
    return out


def record_of(case: str) -> dfc.Record:
    """A record of a case, the same in every run."""
    noise, quantum, cogging = CASES[case]
    t = DT * np.arange(SAMPLES)
    u = 20.0 * np.sin(6.0 * t) + 12.0 * np.sin(17.0 * t + 1.0)
    x = machine(u, DT, SUBSTEPS, MASS, VISCOUS, COULOMB, cogging, PITCH, 0.0, 0.0)[0]
    u = u + noise * np.random.default_rng(5).standard_normal(SAMPLES)
    return dfc.Record(t, u, quantum * np.round(x / quantum), quantum=quantum, name=case)


# --- ours -----------------------------------------------------------------------------


def ours_fit(record: dfc.Record) -> Found:
    axis = dfc.FrictionAxis(*START)
    fitted = dfc.fit(axis, record)
    return Found(
        np.array(list(fitted.parameters.values())),
        np.array(list(fitted.standard_errors.values())),
        axis=fitted.axis,
    )


def ours_regression(record: dfc.Record) -> Found:
    found = dfc.identification.force_regression(record)
    values, errors = found.parameters.values(), found.standard_errors.values()
    return Found(np.array(list(values)), np.array(list(errors)))


def ours_diagnose(record: dfc.Record) -> Found:
    d = dfc.diagnose(dfc.FrictionAxis(*START), record, jobs=1, progress=False)
    base = d.extended.effective()
    values = np.array([base.mass, base.viscous, base.coulomb.mean])
    added = [c.title for c in d.causes if c.effect not in ("inertia", "viscous", "coulomb")]
    return Found(values, None, ", ".join(added) or "none beyond the model", d.extended)


# --- scipy ----------------------------------------------------------------------------


def motion(record: dfc.Record, size: int = 31) -> tuple[np.ndarray, ...]:
    """Position, velocity and acceleration by a cubic Savitzky-Golay filter."""
    return tuple(savgol_filter(record.x, size, 3, d, DT) for d in (0, 1, 2))


def moving_samples(record: dfc.Record) -> tuple[np.ndarray, ...]:
    """Velocity, acceleration and smoothed drive where the axis moves."""
    _, v, a = motion(record)
    u = np.convolve(record.u, np.ones(31) / 31.0, "same")
    moving = np.abs(v) > 0.05 * np.abs(v).max()
    return v[moving], a[moving], u[moving]


def scipy_regression(record: dfc.Record) -> Found:
    """Linear least squares of the drive, where the axis moves."""
    v, a, u = moving_samples(record)
    rows = np.column_stack([a, v, np.sign(v)])
    values, rest, _, _ = np.linalg.lstsq(rows, u, rcond=None)
    variance = float(rest[0]) / (rows.shape[0] - 3)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(rows.T @ rows)))
    return Found(values, errors)


def fitted_scale(found: OptimizeResult) -> Found:
    """Values and standard errors of a least-squares fit of factors on START."""
    covariance = np.linalg.inv(found.jac.T @ found.jac) * 2.0 * found.cost / found.fun.size
    return Found(found.x * START, np.sqrt(np.diag(covariance)) * START)


def scipy_output_error(record: dfc.Record) -> Found:
    """Nonlinear least squares of the position over free runs of 0.25 s, compiled by numba."""
    x, v, _ = motion(record)
    starts = range(15, len(record) - WINDOW, WINDOW)

    def errors(scale: np.ndarray) -> np.ndarray:
        runs = [
            machine(record.u[k : k + WINDOW], DT, 10, *(scale * START), 0.0, PITCH, x[k], v[k])[0]
            - record.x[k : k + WINDOW]
            for k in starts
        ]
        return np.concatenate(runs)

    found = least_squares(errors, np.ones(3), x_scale=0.1, diff_step=1e-3)
    return fitted_scale(found)


# --- python-control alone -------------------------------------------------------------


def control_alone(record: dfc.Record) -> Found:
    """`input_output_response` of a block with friction tanh(v/1 mm/s), fitted by scipy."""
    n = 2000  # 2 s from rest: errors of longer free runs have many minima

    def update(t, state, u, p):  # type: ignore[no-untyped-def]
        friction = p["f"] * state[1] + p["c"] * np.tanh(state[1] / 1e-3)
        return [state[1], (u[0] - friction) / p["m"]]

    block = ct.nlsys(update, None, inputs=1, outputs=2, states=2, params={"m": 1, "f": 1, "c": 1})

    def errors(scale: np.ndarray) -> np.ndarray:
        run = ct.input_output_response(
            block,
            record.t[:n],
            record.u[:n],
            [record.x[0], 0.0],
            solve_ivp_method="LSODA",
            solve_ivp_kwargs={"rtol": 1e-7, "atol": 1e-9},
            params=dict(zip("mfc", scale * START, strict=True)),
        )
        return np.asarray(run.outputs[0] - record.x[:n])

    found = least_squares(errors, np.ones(3), x_scale=0.1, diff_step=1e-3, max_nfev=12)
    return fitted_scale(found)


# --- pysindy --------------------------------------------------------------------------


def sindy(record: dfc.Record) -> Found:
    """Sparse regression of the acceleration on v, sign v and u."""
    import pysindy as ps

    v, a, u = moving_samples(record)
    powers = [lambda one: one, lambda one: one**2, lambda one: one**3]
    terms = ps.CustomLibrary(
        library_functions=[*powers, lambda one: np.sign(one)],
        function_names=[
            lambda one: one,
            lambda one: f"{one}^2",
            lambda one: f"{one}^3",
            lambda one: f"sign({one})",
        ],
    )
    model = ps.SINDy(optimizer=ps.STLSQ(threshold=0.2), feature_library=terms)
    model.fit(v[:, None], t=DT, x_dot=a[:, None], u=u[:, None], feature_names=["v", "u"])
    names, row = model.get_feature_names(), model.coefficients()[0]
    found = dict(zip(names, row, strict=True))
    more = [n for n, c in found.items() if c != 0.0 and n not in ("v", "u", "sign(v)")]
    values = np.array([1.0, -found["v"], -found["sign(v)"]]) / found["u"]
    return Found(values, None, "terms " + ", ".join(more) if more else "")


# --- mujoco.sysid ---------------------------------------------------------------------

SLIDE = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="slide">
      <inertial pos="0 0 0" mass="2.6" diaginertia="1 1 1"/>
      <joint name="x" type="slide" axis="1 0 0" damping="10" frictionloss="10"/>
    </body>
  </worldbody>
  <actuator><motor name="u" joint="x"/></actuator>
  <sensor><jointpos name="position" joint="x"/></sensor>
</mujoco>
"""


def mujoco_sysid(record: dfc.Record) -> Found:
    """Its toolbox with its defaults, on free runs of 0.25 s of a slide joint."""
    import mujoco
    from mujoco import sysid
    from mujoco.sysid import ParameterDict

    spec = mujoco.MjSpec.from_string(SLIDE)
    model = spec.compile()
    x, v, _ = motion(record)
    starts = range(15, len(record) - WINDOW, WINDOW)
    states, drives, readings = [], [], []
    for k in starts:
        state = sysid.create_initial_state(model, x[k : k + 1], v[k : k + 1], np.empty(0))
        times = DT * np.arange(WINDOW)
        states.append(state)
        drives.append(sysid.TimeSeries(times, record.u[k : k + WINDOW, None]))
        series = record.x[k + 1 : k + WINDOW, None]
        readings.append(sysid.TimeSeries.from_names(times[1:], series, model))
    names = [f"run {k}" for k in starts]
    runs = sysid.ModelSequences("slide", spec, names, states, drives, readings)

    def damping(spec, p):  # type: ignore[no-untyped-def]
        spec.joint("x").damping = [p.value[0], 0.0, 0.0]

    modifiers = {
        "mass": lambda s, p: setattr(s.body("slide"), "mass", p.value[0]),
        "damping": damping,
        "frictionloss": lambda s, p: setattr(s.joint("x"), "frictionloss", p.value[0]),
    }
    params = ParameterDict()
    for (name, change), start in zip(modifiers.items(), START, strict=True):
        params.add(
            sysid.Parameter(
                name, nominal=start, min_value=0.2 * start, max_value=5.0 * start, modifier=change
            )
        )
    residual = sysid.build_residual_fn(models_sequences=[runs], n_threads=1)
    best, result = sysid.optimize(params, residual, verbose=False)
    left = residual(result.x, best)[0]
    covariance, _ = sysid.calculate_intervals(left, result.jac)
    return Found(np.array(best.as_vector()), np.sqrt(np.diag(covariance)))


def truth(record: dfc.Record) -> Found:
    """What there is to find."""
    name = record.name
    cogging = dfc.effects.Cogging(amplitude=CASES[name][2], period=PITCH, phase=0.0)
    axis = dfc.FrictionAxis(*TRUE, effects=(cogging,) if CASES[name][2] else ())
    return Found(TRUE, axis=axis)


PEERS: dict[str, Callable[[dfc.Record], Found]] = {
    "the machine itself": truth,
    "ours, axis_from": ours_regression,
    "ours, fit": ours_fit,
    "ours, diagnose": ours_diagnose,
    "scipy, force regression": scipy_regression,
    "scipy, free runs": scipy_output_error,
    "python-control and scipy": control_alone,
    "pysindy": sindy,
    "mujoco.sysid": mujoco_sysid,
}


def processor_time() -> float:
    """User and system time of this process, its threads and its children [s]."""
    return sum(os.times()[:4])


def row(work: Callable[[dfc.Record], Found], case: str, repeats: int) -> list[str]:
    """Cells of one peer on one case."""
    train, test = record_of(case).split(PART)
    spent = []
    for _ in range(repeats):
        begin = processor_time()
        with contextlib.redirect_stdout(io.StringIO()):
            found = work(train)
        spent.append(processor_time() - begin)
    deviations = ["-"] * 3
    if found.errors is not None:
        deviations = [f"{abs(d):.1f}" for d in (found.values - TRUE) / found.errors]
    axis = found.axis or dfc.FrictionAxis(*np.maximum(found.values, 1e-9))
    return [
        *(f"{one:+.2f}" for one in 100.0 * (found.values / TRUE - 1.0)),
        " / ".join(deviations),
        f"{1e6 * dfc.replay(axis, test).median:.0f}",
        f"{min(spent):.2f}",
        found.cause or "-",
    ]


def main() -> None:
    """Print a table of each case."""
    chosen = parser_of(__doc__, {"--cases": (tuple(CASES), "records")})
    chosen.add_argument("--only", nargs="+", default=[""], help="parts of the names of peers")
    given = chosen.parse_args()
    warnings.simplefilter("ignore")
    logging.disable(logging.WARNING)
    head = ["", "mass %", "viscous %", "Coulomb %", "in its standard errors", "free runs um",
            "s", "cause named"]  # fmt: skip
    for case in given.cases:
        noise, quantum, cogging = CASES[case]
        print(f"\n{case}: drive noise {noise:g} N, encoder {1e6 * quantum:g} um, "
              f"cogging {cogging:g} N")  # fmt: skip
        print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
        for name, work in PEERS.items():
            if any(one in name for one in given.only):
                # What is compiled, or cached, in a first call is not what a call costs.
                repeats = 2 if "ours" in name or "scipy, " in name else 1
                try:
                    cells = row(work, case, repeats)
                except ImportError as missing:
                    cells = [f"not installed: {missing.name}"]
                print(f"| {' | '.join([name, *cells])} |", flush=True)


if __name__ == "__main__":
    main()
