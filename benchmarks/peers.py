"""What else solves the stick-slip run: one function a peer, each written with care.

A mass is pulled through a spring whose end moves at constant speed, for 40 s; every peer
returns the times at which the mass breaks away. Nothing here imports the package: these
are the independent sides of the comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import control as ct
import numpy as np
from numba import njit
from scipy.integrate import ode, odeint, solve_ivp
from scipy.optimize import brentq

try:
    import mujoco
except ImportError:  # the comparison then says so
    mujoco = None


@dataclass(frozen=True)
class StickSlip:
    """m v' = k (belt t - x) - F, from rest at x = 0; SI units."""

    mass: float = 1.0
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


def events_solve_ivp(problem: StickSlip, method: str, rtol: float) -> Breaks:
    """Three modes by `solve_ivp`: sliding with a terminal event, rest in closed form."""
    m, k, belt, sigma = problem.mass, problem.stiffness, problem.belt, problem.stick_speed
    fc, excess, vs, slip = (
        problem.coulomb,
        problem.excess,
        problem.stribeck_speed,
        problem.slip_speed,
    )
    exp = math.exp

    def rates(t, y):
        v = y[1]
        q = (v - sigma) / vs
        return [v, (k * (belt * t - y[0]) - fc * (1 + excess * exp(-q * q))) / m]

    def stop(t, y):
        return y[1] - sigma

    def slips(t, y):
        return y[1] - slip

    stop.terminal, stop.direction = True, -1
    slips.direction = 1
    modes, through = [], []
    t, x, v = problem.rest(0.0, 0.0, 0.0)
    while t < problem.duration:
        modes.append(t)
        run = solve_ivp(
            rates,
            (t, problem.duration),
            [x, v],
            method,
            rtol=rtol,
            atol=1e-3 * rtol,
            events=(stop, slips),
        )
        through.extend(run.t_events[1])
        if run.status != 1:
            break
        t, (x, v) = run.t_events[0][-1], run.y_events[0][-1]
        # Here |v| = Sigma and the load is inside the Coulomb band: the mass sticks.
        assert abs(k * (belt * t - x)) <= fc
        t, x, v = problem.rest(t, x, v)
    return Breaks(np.array(modes), np.array(through))


def events_dop853(problem: StickSlip, rtol: float) -> Breaks:
    """The same with scipy's compiled DOP853, stopped by its step callback."""
    m, k, belt, sigma = problem.mass, problem.stiffness, problem.belt, problem.stick_speed
    fc, excess, vs, slip = (
        problem.coulomb,
        problem.excess,
        problem.stribeck_speed,
        problem.slip_speed,
    )
    exp = math.exp

    def rates(t, y):
        v = y[1]
        q = (v - sigma) / vs
        return (v, (k * (belt * t - y[0]) - fc * (1 + excess * exp(-q * q))) / m)

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


# --- LuGre and tanh -------------------------------------------------------------------


def lugre_rates(problem: StickSlip, stiffness: float = 1e5, damping: float = 300.0):
    """Right-hand side of (x, v, z), Canudas de Wit et al. 1995."""
    m, k, belt, sigma = problem.mass, problem.stiffness, problem.belt, problem.stick_speed
    fc, excess, vs = problem.coulomb, problem.excess, problem.stribeck_speed
    exp = math.exp

    def rates(t, y):
        x, v, z = y
        speed = abs(v)
        q = (speed - sigma) / vs
        dz = v - stiffness * speed * z / (fc * (1 + excess * exp(-q * q)))
        return [v, (k * (belt * t - x) - stiffness * z - damping * dz) / m, dz]

    return rates


def tanh_rates(problem: StickSlip, speed: float = 1e-5):
    """Right-hand side of (x, v) with F = level tanh(v / speed)."""
    m, k, belt, sigma = problem.mass, problem.stiffness, problem.belt, problem.stick_speed
    fc, excess, vs = problem.coulomb, problem.excess, problem.stribeck_speed
    exp, tanh = math.exp, math.tanh

    def rates(t, y):
        x, v = y
        q = (abs(v) - sigma) / vs
        return [v, (k * (belt * t - x) - fc * (1 + excess * exp(-q * q)) * tanh(v / speed)) / m]

    return rates


def smooth_solve_ivp(problem: StickSlip, rates, states: int, method: str, rtol: float) -> Breaks:
    """A smooth law by `solve_ivp`, slips by its events."""

    def slips(t, y):
        return y[1] - problem.slip_speed

    slips.direction = 1
    run = solve_ivp(
        rates,
        (0.0, problem.duration),
        [0.0] * states,
        method,
        rtol=rtol,
        atol=1e-4 * rtol,
        events=slips,
    )
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


def smooth_odeint(problem: StickSlip, rates, states: int, rtol: float, dt: float = 1e-2) -> Breaks:
    """A smooth law by `odeint`, whose stepping is compiled throughout."""
    t = np.arange(round(problem.duration / dt) + 1) * dt
    y = odeint(rates, [0.0] * states, t, rtol=rtol, atol=1e-4 * rtol, tfirst=True, mxstep=1_000_000)
    return Breaks(np.empty(0), slips_of_samples(problem, t, y[:, 0], y[:, 1]))


def control_response(problem: StickSlip, rates, states: int, method: str, rtol: float) -> Breaks:
    """A smooth law as a python-control system, driven by the spring's moving end."""

    # python-control hands the input over apart from the state: t = end / belt.
    def update(t, y, u, params):
        return rates(u[0] / problem.belt, y)

    system = ct.nlsys(update, None, inputs=1, outputs=states, states=states)
    t = np.arange(round(problem.duration / 1e-2) + 1) * 1e-2
    run = ct.input_output_response(
        system,
        t,
        problem.belt * t,
        solve_ivp_method=method,
        solve_ivp_kwargs={"rtol": rtol, "atol": 1e-4 * rtol},
    )
    return Breaks(np.empty(0), slips_of_samples(problem, t, run.states[0], run.states[1]))


# --- MuJoCo ---------------------------------------------------------------------------

# Friction constraint as stiff as the solver takes it: the default impedance lets the
# "stuck" joint creep.
STIFF = "0.9999 0.9999 0.001 0.5 2"

SLIDE = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="{integrator}" solver="Newton"
          tolerance="0" iterations="20"/>
  <worldbody>
    <body>
      <joint name="slide" type="slide" axis="1 0 0" frictionloss="{friction}"
             damping="{damping}" solreffriction="{solref}" solimpfriction="{solimp}"/>
      <geom type="sphere" size="0.1" mass="{mass}" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""


def mujoco_slide(
    problem: StickSlip,
    step: float,
    solref: str,
    solimp: str = STIFF,
    integrator: str = "implicitfast",
) -> Breaks:
    """MuJoCo's slide joint; its friction loss set from the speed before each step."""
    model = mujoco.MjModel.from_xml_string(
        SLIDE.format(
            step=step,
            friction=problem.breakaway,
            solref=solref,
            solimp=solimp,
            mass=problem.mass,
            integrator=integrator,
            damping=0.0,
        )
    )
    data = mujoco.MjData(model)
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
