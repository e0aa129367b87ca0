"""What else solves the stick-slip run and the servo loop: a function a peer, written with care.

A mass is pulled through a spring whose end moves at constant speed, for 40 s; every peer returns
the times at which the mass breaks away.  In the sampled servo loop every peer returns position and
mode at the samples.  Nothing here imports the package: these are the independent sides of the
comparison.
"""

from __future__ import annotations

import contextlib
import io
import math
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import control as ct
import numpy as np
from numba import njit
from scipy.integrate import ode, odeint, solve_ivp
from scipy.optimize import brentq

# Where one of these is not installed, the comparison says so.
try:
    import mujoco
except ImportError:
    mujoco = None
try:
    import fmpy
except ImportError:
    fmpy = None
try:
    import casadi
    import nosnoc
except ImportError:
    nosnoc = None
gcc = shutil.which("gcc")


@dataclass(frozen=True)
class StickSlip:
    """m v' = k (belt t - x) - F, from rest at x = 0; SI units."""

    mass: float = 1.0
    viscous: float = 0.0
    coulomb: float = 1.0
    excess: float = 0.5
    stribeck_speed: float = 1e-3
    stick_speed: float = 1e-6
    stick_rate: float = 500.0
    stiffness: float = 2.0
    belt: float = 0.1
    duration: float = 40.0
    # Laws without a stuck mode have no instant of breakaway: theirs is the time at which
    # the speed rises through this value, ten Stribeck speeds, where friction is at Fc.
    slip_speed: float = 1e-2

    @property
    def breakaway(self) -> float:
        return (1 + self.excess) * self.coulomb

    def level(self, v: float) -> float:
        q = (v - self.stick_speed) / self.stribeck_speed
        return self.coulomb * (1 + self.excess * math.exp(-q * q))

    def rest(self, t: float, x: float, v: float) -> tuple[float, float, float]:
        """Breakaway after coming to rest at t: time, position, speed. Closed form."""
        p = self.stick_rate

        def short(tau: float) -> float:
            where = x - v * math.expm1(-p * tau) / p
            return self.stiffness * (self.belt * (t + tau) - where) - self.breakaway

        end = (self.breakaway / self.stiffness + x + abs(v) / p) / self.belt - t + 1.0
        tau = brentq(short, 0.0, end, xtol=1e-14, rtol=1e-15)
        return t + tau, x - v * math.expm1(-p * tau) / p, v * math.exp(-p * tau)


@dataclass(frozen=True)
class Breaks:
    """Times at which the mass leaves the stuck mode, and rises through `slip_speed`."""

    modes: np.ndarray
    slips: np.ndarray


# --- the switched model ---------------------------------------------------------------


def sliding_rates(problem: StickSlip):
    """Right-hand side of (x, v) while the mass slides forward."""
    m, k, belt, sigma = problem.mass, problem.stiffness, problem.belt, problem.stick_speed
    fc, excess, vs, exp = problem.coulomb, problem.excess, problem.stribeck_speed, math.exp

    def rates(t, y):
        q = (y[1] - sigma) / vs
        return (y[1], (k * (belt * t - y[0]) - fc * (1 + excess * exp(-q * q))) / m)

    return rates


def crossing_of(value: float, direction: int, terminal: bool):
    """An event of `solve_ivp`: the velocity crosses a value."""

    def event(t, y):
        return y[1] - value

    event.terminal, event.direction = terminal, direction
    return event


def events_solve_ivp(problem: StickSlip, method: str, rtol: float) -> Breaks:
    """Three modes by `solve_ivp`: sliding with a terminal event, rest in closed form."""
    stop = crossing_of(problem.stick_speed, -1, True)
    slips = crossing_of(problem.slip_speed, 1, False)
    rates, options = sliding_rates(problem), {"rtol": rtol, "atol": 1e-3 * rtol}
    modes, through = [], []
    t, x, v = problem.rest(0.0, 0.0, 0.0)
    while t < problem.duration:
        modes.append(t)
        span = (t, problem.duration)
        run = solve_ivp(rates, span, [x, v], method, events=(stop, slips), **options)
        through.extend(run.t_events[1])
        if run.status != 1:
            break
        t, (x, v) = run.t_events[0][-1], run.y_events[0][-1]
        # v fell to Sigma and the load is inside the Coulomb band: the mass sticks.
        assert abs(problem.stiffness * (problem.belt * t - x)) <= problem.coulomb
        t, x, v = problem.rest(t, x, v)
    return Breaks(np.array(modes), np.array(through))


def events_dop853(problem: StickSlip, rtol: float) -> Breaks:
    """The same with scipy's compiled DOP853, stopped by its step callback."""
    sigma, slip, rates = problem.stick_speed, problem.slip_speed, sliding_rates(problem)
    before = [0.0, 0.0, 0.0]
    around_slip: list[tuple[float, float, float]] = []

    def watch(t, y):
        x, v = y
        if before[2] > sigma >= v:
            return -1
        if before[2] < slip <= v:
            around_slip.append(tuple(before))
        before[:] = t, x, v
        return 0

    def new_solver():
        return ode(rates).set_integrator("dop853", rtol=rtol, atol=1e-3 * rtol, nsteps=100_000)

    solver = new_solver()
    solver.set_solout(watch)
    single = new_solver()

    def crossing(start, end, level):
        """Time and state at which v meets the level, from the last step's start."""
        t0, x0, v0 = start

        def miss(t):
            if t == t0:
                return v0 - level
            single.set_initial_value((x0, v0), t0)
            return single.integrate(t)[1] - level

        t = brentq(miss, t0, end, xtol=1e-12, rtol=1e-14)
        single.set_initial_value((x0, v0), t0)
        x, v = single.integrate(t)
        return t, x, v

    modes, through = [], []
    t, x, v = problem.rest(0.0, 0.0, 0.0)
    while t < problem.duration:
        modes.append(t)
        before[:] = t, x, v
        around_slip.clear()
        solver.set_initial_value((x, v), t)
        solver.integrate(problem.duration)
        if around_slip:
            t0 = around_slip[0]
            through.append(crossing(t0, min(t0[0] + 0.5, solver.t), slip)[0])
        if solver.t >= problem.duration:
            break
        t, x, v = crossing(before, solver.t, sigma)
        t, x, v = problem.rest(t, x, v)
    return Breaks(np.array(modes), np.array(through))


@njit(cache=True)
def _euler(m, k, belt, fc, excess, vs, sigma, slip, h, n, modes, through):
    x = v = 0.0
    stuck = True
    count = crossed = 0
    for i in range(n):
        w = k * (belt * i * h - x)
        if stuck:
            if w > (1 + excess) * fc:
                stuck = False
                if count < modes.size:
                    modes[count] = i * h
                    count += 1
        if not stuck:
            q = (v - sigma) / vs
            after = v + h * (w - fc * (1 + excess * math.exp(-q * q))) / m
            if v < slip <= after and crossed < through.size:
                through[crossed] = (i + (slip - v) / (after - v)) * h
                crossed += 1
            v = after
            x += h * v
            if v <= sigma and abs(w) <= fc:
                stuck = True
                v = 0.0
    return count, crossed


def euler_loop(problem: StickSlip, step: float) -> Breaks:
    """A compiled fixed-step Euler loop with the three modes, the usual hand-rolled way."""
    modes, through = np.empty(64), np.empty(64)
    count, crossed = _euler(
        problem.mass,
        problem.stiffness,
        problem.belt,
        problem.coulomb,
        problem.excess,
        problem.stribeck_speed,
        problem.stick_speed,
        problem.slip_speed,
        step,
        round(problem.duration / step),
        modes,
        through,
    )
    return Breaks(modes[:count], through[:crossed])


# --- smooth laws ----------------------------------------------------------------------


class Smooth(NamedTuple):
    """A law without modes: the right-hand side, and of how many states."""

    rates: Callable[[float, Any], list[float]]
    states: int


def lugre_rates(problem: StickSlip, stiffness: float = 1e5, damping: float = 300.0):
    """Right-hand side of (x, v, z), Canudas de Wit et al. 1995."""
    m, k, belt = problem.mass, problem.stiffness, problem.belt
    fc, excess, vs = problem.coulomb, problem.excess, problem.stribeck_speed
    exp = math.exp

    def rates(t, y):
        x, v, z = y
        speed = abs(v)
        q = speed / vs
        dz = v - stiffness * speed * z / (fc * (1 + excess * exp(-q * q)))
        return [v, (k * (belt * t - x) - stiffness * z - damping * dz) / m, dz]

    return Smooth(rates, 3)


def tanh_rates(problem: StickSlip, speed: float = 1e-5):
    """Right-hand side of (x, v) with F = level tanh(v / speed)."""
    m, k, belt = problem.mass, problem.stiffness, problem.belt
    fc, excess, vs = problem.coulomb, problem.excess, problem.stribeck_speed
    exp, tanh = math.exp, math.tanh

    def rates(t, y):
        x, v = y
        q = v / vs
        return [v, (k * (belt * t - x) - fc * (1 + excess * exp(-q * q)) * tanh(v / speed)) / m]

    return Smooth(rates, 2)


def smooth_solve_ivp(problem: StickSlip, law: Smooth, method: str, rtol: float) -> Breaks:
    """A smooth law by `solve_ivp`, slips by its events."""
    slips, span = crossing_of(problem.slip_speed, 1, False), (0.0, problem.duration)
    options = {"rtol": rtol, "atol": 1e-4 * rtol}
    start = [0.0] * law.states
    run = solve_ivp(law.rates, span, start, method, events=slips, **options)
    return Breaks(np.empty(0), run.t_events[0])


def slips_of_samples(problem: StickSlip, t, x, v, friction=None) -> np.ndarray:
    """Times at which a sampled speed rises through `slip_speed`, by cubic interpolation.

    Friction is at the Coulomb level there unless given, so the acceleration is known.
    """
    rising = np.flatnonzero((v[:-1] < problem.slip_speed) & (v[1:] >= problem.slip_speed))
    times = []
    for i in rising:
        h = t[i + 1] - t[i]
        force = [problem.level(v[j]) if friction is None else friction[j] for j in (i, i + 1)]
        a0, a1 = (
            (problem.stiffness * (problem.belt * t[j] - x[j]) - f) / problem.mass
            for j, f in zip((i, i + 1), force, strict=True)
        )

        def miss(q, i=i, h=h, a0=a0, a1=a1):
            bend = (v[i + 1] - v[i]) / h
            return (
                v[i]
                + q * h * (a0 + q * (3 * bend - 2 * a0 - a1 + q * (a0 + a1 - 2 * bend)))
                - problem.slip_speed
            )

        times.append(t[i] + h * brentq(miss, 0.0, 1.0, xtol=1e-14))
    return np.array(times)


def smooth_odeint(problem: StickSlip, law: Smooth, rtol: float, dt: float = 1e-2) -> Breaks:
    """A smooth law by `odeint`, whose stepping is compiled throughout."""
    t = np.arange(round(problem.duration / dt) + 1) * dt
    options = {"rtol": rtol, "atol": 1e-4 * rtol, "tfirst": True, "mxstep": 1_000_000}
    y = odeint(law.rates, [0.0] * law.states, t, **options)
    return Breaks(np.empty(0), slips_of_samples(problem, t, y[:, 0], y[:, 1]))


def control_response(problem: StickSlip, law: Smooth, method: str, rtol: float) -> Breaks:
    """A smooth law as a python-control system, driven by the spring's moving end."""

    # python-control hands the input over apart from the state: t = end / belt.
    def update(t, y, u, params):
        return law.rates(u[0] / problem.belt, y)

    system = ct.nlsys(update, None, inputs=1, outputs=law.states, states=law.states)
    t = np.arange(round(problem.duration / 1e-2) + 1) * 1e-2
    options = {"rtol": rtol, "atol": 1e-4 * rtol}
    run = ct.input_output_response(
        system, t, problem.belt * t, solve_ivp_method=method, solve_ivp_kwargs=options
    )
    return Breaks(np.empty(0), slips_of_samples(problem, t, run.states[0], run.states[1]))


# --- MuJoCo ---------------------------------------------------------------------------

# Friction constraint as stiff as the solver takes it: the default impedance lets the
# "stuck" joint creep.
STIFF = "0.9999 0.9999 0.001 0.5 2"

SLIDE = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="implicitfast" solver="Newton"
          tolerance="0" iterations="20"/>
  <worldbody>
    <body>
      <joint name="slide" type="slide" axis="1 0 0" frictionloss="{friction}"
             damping="{damping}" solreffriction="0.02 1" solimpfriction="{solimp}"/>
      <geom type="sphere" size="0.1" mass="{mass}" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""


def slide_of(problem: StickSlip | Servo, step: float, solimp: str):
    """MuJoCo's slide joint: model and data."""
    text = SLIDE.format(
        step=step, friction=problem.breakaway, solimp=solimp, mass=problem.mass,
        damping=problem.viscous,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def mujoco_slide(problem: StickSlip, step: float, solimp: str = STIFF) -> Breaks:
    """The slide on its spring; the friction loss set from the speed before each step."""
    model, data = slide_of(problem, step, solimp)
    friction, force, x, v = model.dof_frictionloss, data.qfrc_applied, data.qpos, data.qvel
    k, belt, slip = problem.stiffness, problem.belt, problem.slip_speed
    advance = mujoco.mj_step
    through = []
    now = 0.0
    for i in range(round(problem.duration / step)):
        friction[0] = problem.level(abs(now))
        force[0] = k * (belt * i * step - x[0])
        advance(model, data)
        after = v[0]
        if now < slip <= after:
            through.append((i + (slip - now) / (after - now)) * step)
        now = after
    return Breaks(np.empty(0), np.array(through))


# --- regularised friction as an FMU, and FESD -----------------------------------------


def linear_rates(problem: StickSlip, linear: float = 1e-5):
    """Right-hand side of (x, v) with friction on a straight line through zero within +-linear."""
    m, k, belt, sigma = problem.mass, problem.stiffness, problem.belt, problem.stick_speed
    fc, excess, vs = problem.coulomb, problem.excess, problem.stribeck_speed
    exp = math.exp

    def rates(t, y):
        x, v = y
        fast = max(abs(v), linear)
        q = (fast - sigma) / vs
        friction = fc * (1 + excess * exp(-q * q)) * v / max(abs(v), linear)
        return [v, (k * (belt * t - x) - friction) / m]

    return Smooth(rates, 2)


def fmu_parameters(problem: StickSlip, linear: float = 1e-5) -> dict[str, float]:
    """Start values of the FMU's parameters, in the order of its references."""
    return {
        "mass": problem.mass,
        "stiffness": problem.stiffness,
        "belt": problem.belt,
        "coulomb": problem.coulomb,
        "excess": problem.excess,
        "stribeck": problem.stribeck_speed,
        "stick": problem.stick_speed,
        "linear": linear,
    }


def regularised_fmu(problem: StickSlip, folder: Path) -> Path:
    """That law as an FMU for model exchange, compiled from ``regularised_friction.c``."""
    name, state = "regularised_friction", 'variability="continuous"'
    rows = [
        (f'name="x" causality="output" {state} initial="exact"', 'start="0"'),
        (f'name="v" causality="output" {state} initial="exact"', 'start="0"'),
        (f'name="dx" causality="local" {state}', 'derivative="1"'),
        (f'name="dv" causality="local" {state}', 'derivative="2"'),
    ] + [
        (
            f'name="{key}" causality="parameter" variability="fixed" initial="exact"',
            f'start="{value!r}"',
        )
        for key, value in fmu_parameters(problem).items()
    ]
    variables = "".join(
        f'<ScalarVariable {head} valueReference="{i}"><Real {start}/></ScalarVariable>'
        for i, (head, start) in enumerate(rows)
    )
    pair = "".join(f'<Unknown index="{i}"/>' for i in (1, 2))
    slopes = "".join(f'<Unknown index="{i}"/>' for i in (3, 4))
    description = (
        f'<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}" '
        f'numberOfEventIndicators="0"><ModelExchange modelIdentifier="{name}"/>'
        f"<ModelVariables>{variables}</ModelVariables><ModelStructure><Outputs>{pair}</Outputs>"
        f"<Derivatives>{slopes}</Derivatives></ModelStructure></fmiModelDescription>"
    )
    source, library = Path(__file__).with_name(f"{name}.c"), folder / f"{name}.so"
    headers = Path(fmpy.__file__).parent / "c-code"
    subprocess.run(
        ["gcc", "-O2", "-shared", "-fPIC", f"-I{headers}", source, "-lm", "-o", library], check=True
    )
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("modelDescription.xml", description)
        packed.write(library, f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}")
    return path


def fmu_cvode(problem: StickSlip, path: Path, rtol: float, dt: float = 1e-2) -> Breaks:
    """An FMU for model exchange by CVode, as FMPy does."""
    run = fmpy.simulate_fmu(
        str(path), stop_time=problem.duration, solver="CVode", relative_tolerance=rtol,
        step_size=dt, output_interval=dt, output=["x", "v"], start_values=fmu_parameters(problem),
        validate=False,
    )  # fmt: skip
    return Breaks(np.empty(0), slips_of_samples(problem, run["time"], run["x"], run["v"]))


def fesd(problem: StickSlip, step: float = 0.02, stages: int = 4, elements: int = 3) -> Breaks:
    """nosnoc: finite elements with switch detection, one optimisation problem a step.

    Stuck is its sliding mode of Filippov on v = 0, which lets go at the breakaway force.  The
    velocity is given to it in Stribeck velocities and the tolerance is tight: else
    complementarity that is not exact breaks away early.
    """
    state = casadi.SX.sym("state", 3)
    x, v, t = (state[i] for i in range(3))

    def rates(s):
        q = (s * v - problem.stick_speed) / problem.stribeck_speed
        level = problem.coulomb * (1 + problem.excess * casadi.exp(-q * q))
        return casadi.vertcat(
            v, (problem.stiffness * (problem.belt * t - x) - s * level) / problem.mass, 1
        )

    start = np.zeros(3)
    model = nosnoc.NosnocModel(
        x=state,
        F=[casadi.horzcat(rates(1), rates(-1))],
        S=[np.array([[1], [-1]])],
        c=[v / problem.stribeck_speed],
        x0=start,
    )
    options = nosnoc.NosnocOpts()
    options.n_s, options.N_finite_elements, options.terminal_time = stages, elements, step
    options.comp_tol = options.sigma_N = 1e-9
    options.pss_mode = nosnoc.PssMode.STEP
    options.step_equilibration = nosnoc.StepEquilibrationMode.HEURISTIC_MEAN
    solver = nosnoc.NosnocSolver(options, model)
    loop = nosnoc.NosnocSimLooper(solver, start, round(problem.duration / step), print_level=0)
    with contextlib.redirect_stdout(io.StringIO()):  # it reports steps of its homotopy
        loop.run()
    found = np.array(loop.get_results()["X_sim"])
    return Breaks(np.empty(0), slips_of_samples(problem, found[:, 2], found[:, 0], found[:, 1]))


# --- the sampled servo loop -----------------------------------------------------------


@dataclass(frozen=True)
class Servo:
    """PD position loop at 1 ms on an encoder, slow enough to move in jerks."""

    mass: float = 1.0
    viscous: float = 0.4
    coulomb: float = 1.0
    excess: float = 0.5
    stribeck_speed: float = 1e-2
    stick_speed: float = 1e-4
    stick_rate: float = 500.0
    kp: float = 2000.0
    kd: float = 10.0
    quantum: float = 1e-5
    dt: float = 1e-3
    duration: float = 20.0
    amplitude: float = 0.005
    frequency: float = 0.2

    @property
    def breakaway(self) -> float:
        return (1 + self.excess) * self.coulomb

    @property
    def reference(self) -> np.ndarray:
        t = np.arange(round(self.duration / self.dt)) * self.dt
        return self.amplitude * np.sin(2 * np.pi * self.frequency * t)


def servo(problem: Servo, slide) -> tuple[np.ndarray, np.ndarray]:
    """The loop with three modes; `slide` moves a sliding mass for at most one sample.

    Between samples the force is held and nothing depends on position, so at rest the load
    cannot change inside a sample, and a sliding mass can meet only one level: the band
    Sigma if the load is inside the Coulomb band, else v = 0.
    """
    p = problem
    half, sigma, rate, breakaway = p.coulomb, p.stick_speed, p.stick_rate, p.breakaway
    at_zero = p.coulomb * (1 + p.excess * math.exp(-((sigma / p.stribeck_speed) ** 2)))
    fade = math.exp(-rate * p.dt)
    reference = p.reference.tolist()
    xs, modes = np.empty(len(reference)), np.empty(len(reference))
    x = v = 0.0
    mode = 0
    last = 0.0
    for k, r in enumerate(reference):
        y = p.quantum * math.floor(x / p.quantum + 0.5)
        u = p.kp * (r - y) - p.kd * (y - last) / p.dt
        last = y
        if mode == 0:
            if abs(u) > breakaway:
                mode = 1 if u > 0 else -1
                if mode * v < 0.0:
                    v = 0.0
        elif mode * v <= sigma and abs(u) <= half:
            mode = 0
        xs[k], modes[k] = x, mode
        left = p.dt
        while left > 0.0:
            if mode == 0:
                decay = fade if left == p.dt else math.exp(-rate * left)
                x += v * (1 - decay) / rate
                v *= decay
                break
            level = sigma if abs(u) <= half and mode * v > sigma else 0.0
            taken, x, v, met = slide(x, v, mode, u, level, left)
            left = left - taken if met else 0.0
            if met:
                v = mode * level
                if level > 0.0 or mode * u <= at_zero:
                    mode = -mode if -mode * u > breakaway else 0
    return xs, modes


def servo_rates(problem: Servo, s: int, u: float):
    m, f, fc = problem.mass, problem.viscous, problem.coulomb
    excess, vs, sigma = problem.excess, problem.stribeck_speed, problem.stick_speed
    exp = math.exp

    def rates(t, y):
        q = (s * y[1] - sigma) / vs
        return (y[1], (u - f * y[1] - s * fc * (1 + excess * exp(-q * q))) / m)

    return rates


def servo_solve_ivp(problem: Servo, method: str, rtol: float, max_step: float = math.inf):
    """Each sample by `solve_ivp` with a terminal event."""

    def slide(x, v, s, u, level, h):
        def stop(t, y):
            return s * y[1] - level

        stop.terminal, stop.direction = True, -1
        run = solve_ivp(
            servo_rates(problem, s, u),
            (0.0, h),
            [x, v],
            method,
            rtol=rtol,
            atol=1e-4 * rtol,
            events=stop,
            first_step=min(h, max_step),
            max_step=max_step,
        )
        return run.t[-1], run.y[0, -1], run.y[1, -1], run.status == 1

    return servo(problem, slide)


def servo_dop853(problem: Servo, rtol: float):
    """Each sample by scipy's compiled DOP853, cut by repeating it when v falls through."""

    def slide(x, v, s, u, level, h):
        solver = ode(servo_rates(problem, s, u)).set_integrator(
            "dop853", rtol=rtol, atol=1e-4 * rtol, first_step=h
        )

        def advance(t):
            solver.set_initial_value((x, v), 0.0)
            return solver.integrate(t) if t > 0.0 else (x, v)

        xn, vn = advance(h)
        if s * vn > level:
            return h, xn, vn, False
        if s * v <= level:
            return 0.0, x, v, s * vn < s * v
        t = brentq(lambda t: s * advance(t)[1] - level, 0.0, h, xtol=1e-14, rtol=1e-13)
        xn, vn = advance(t)
        return t, xn, vn, True

    return servo(problem, slide)


def servo_rk4(problem: Servo, substeps: int):
    """Each sample by a hand-written Runge-Kutta step in plain Python, cut by `brentq`."""
    m, f, fc = problem.mass, problem.viscous, problem.coulomb
    excess, vs, sigma = problem.excess, problem.stribeck_speed, problem.stick_speed
    exp = math.exp

    def advance(x, v, s, u, h):
        def rate(v):
            q = (s * v - sigma) / vs
            return (u - f * v - s * fc * (1 + excess * exp(-q * q))) / m

        # The force does not depend on x here: a quarter of the usual work on positions.
        a1 = rate(v)
        a2 = rate(v + 0.5 * h * a1)
        a3 = rate(v + 0.5 * h * a2)
        a4 = rate(v + h * a3)
        return x + h * (v + h * (a1 + a2 + a3) / 6), v + h * (a1 + 2 * (a2 + a3) + a4) / 6

    def slide(x, v, s, u, level, h):
        step = h / substeps
        for i in range(substeps):
            xn, vn = advance(x, v, s, u, step)
            if s * vn <= level:
                if s * v <= level:
                    if s * vn < s * v:
                        return i * step, x, v, True
                else:
                    cut = brentq(
                        lambda t, x=x, v=v: s * advance(x, v, s, u, t)[1] - level,
                        0.0,
                        step,
                        xtol=1e-15,
                        rtol=1e-14,
                    )
                    xn, vn = advance(x, v, s, u, cut)
                    return i * step + cut, xn, vn, True
            x, v = xn, vn
        return h, x, v, False

    return servo(problem, slide)


def servo_mujoco(problem: Servo):
    """MuJoCo's slide joint in the same loop, stiffened; friction loss set from the speed."""
    p = problem
    model, data = slide_of(p, p.dt, STIFF)
    friction, force, x, v = model.dof_frictionloss, data.qfrc_applied, data.qpos, data.qvel
    reference = p.reference.tolist()
    xs, modes = np.empty(len(reference)), np.empty(len(reference))
    last = 0.0
    for k, r in enumerate(reference):
        xs[k] = x[0]
        y = p.quantum * math.floor(x[0] / p.quantum + 0.5)
        force[0] = p.kp * (r - y) - p.kd * (y - last) / p.dt
        last = y
        modes[k] = 0 if abs(v[0]) <= p.stick_speed else math.copysign(1, v[0])
        q = (abs(v[0]) - p.stick_speed) / p.stribeck_speed
        friction[0] = p.coulomb * (1 + p.excess * math.exp(-q * q))
        mujoco.mj_step(model, data)
    return xs, modes
