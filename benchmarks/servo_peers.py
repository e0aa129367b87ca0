"""What else runs the sampled servo loop: one function a peer, each written with care.

Every peer returns position and mode at the samples. Nothing here imports the package.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.integrate import ode, solve_ivp
from scipy.optimize import brentq
from simulation_peers import SLIDE, STIFF, mujoco


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
    half, sigma, rate = p.coulomb, p.stick_speed, p.stick_rate
    breakaway = (1 + p.excess) * p.coulomb
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


@njit(cache=True)
def _servo_euler(
    reference, m, f, fc, excess, vs, sigma, rate, kp, kd, quantum, dt, substeps, xs, modes
):
    x = v = last = 0.0
    mode = 0
    h = dt / substeps
    for k in range(reference.size):
        y = quantum * math.floor(x / quantum + 0.5)
        u = kp * (reference[k] - y) - kd * (y - last) / dt
        last = y
        for i in range(substeps):
            if mode == 0:
                if abs(u) > (1 + excess) * fc:
                    mode = 1 if u > 0 else -1
                    if mode * v < 0.0:
                        v = 0.0
            elif mode * v <= sigma and abs(u) <= fc:
                mode = 0
            if i == 0:
                xs[k] = x
                modes[k] = mode
            if mode == 0:
                v -= h * rate * v
            else:
                q = (mode * v - sigma) / vs
                v += h * (u - f * v - mode * fc * (1 + excess * math.exp(-q * q))) / m
                if mode * v < 0.0 and abs(u) <= (1 + excess) * fc:
                    v = 0.0
                    mode = 0
                elif mode * v < 0.0:
                    mode = -mode
            x += h * v


def servo_euler(problem: Servo, substeps: int):
    """A compiled Euler loop with substeps, the usual hand-rolled way."""
    p = problem
    reference = p.reference
    xs, modes = np.empty(reference.size), np.empty(reference.size)
    _servo_euler(
        reference,
        p.mass,
        p.viscous,
        p.coulomb,
        p.excess,
        p.stribeck_speed,
        p.stick_speed,
        p.stick_rate,
        p.kp,
        p.kd,
        p.quantum,
        p.dt,
        substeps,
        xs,
        modes,
    )
    return xs, modes


def servo_mujoco(problem: Servo, substeps: int, solref: str, solimp: str = STIFF):
    """MuJoCo's slide joint in the same loop; friction loss set from the speed."""
    p = problem
    model = mujoco.MjModel.from_xml_string(
        SLIDE.format(
            step=p.dt / substeps,
            friction=p.coulomb,
            solref=solref,
            solimp=solimp,
            mass=p.mass,
            integrator="implicitfast",
            damping=p.viscous,
        )
    )
    data = mujoco.MjData(model)
    friction, force, x, v = model.dof_frictionloss, data.qfrc_applied, data.qpos, data.qvel
    reference = p.reference.tolist()
    xs, modes = np.empty(len(reference)), np.empty(len(reference))
    last = 0.0
    for k, r in enumerate(reference):
        now = x[0]
        y = p.quantum * math.floor(now / p.quantum + 0.5)
        force[0] = p.kp * (r - y) - p.kd * (y - last) / p.dt
        last = y
        xs[k] = now
        modes[k] = 0 if abs(v[0]) <= p.stick_speed else math.copysign(1, v[0])
        for _ in range(substeps):
            q = (abs(v[0]) - p.stick_speed) / p.stribeck_speed
            friction[0] = p.coulomb * (1 + p.excess * math.exp(-q * q))
            mujoco.mj_step(model, data)
    return xs, modes
