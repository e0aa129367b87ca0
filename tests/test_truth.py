"""The truth generator against closed forms, and its promises to its users.

It shares no code with the package, so that nothing here imports the package.
"""

from __future__ import annotations

from math import exp, log, pi, sqrt
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from truth import (
    CONDITIONS,
    EFFECTS,
    EQUAL,
    OUTSIDE,
    RECORDERS,
    Plant,
    make_case,
    make_machine,
    make_null,
    make_pair,
    open_loop,
)
from truth.bench import DT, LOUD, VISIBLE, WINDOW
from truth.plant import LAG, NSTATES, REST, VL, XL, V, X, Z, free_runs


@njit
def rate(m, f, fc, sigma, edge, vs, u, v, s):
    return (u - f * v - s * fc * (1.0 + sigma * exp(-(((s * v - edge) / vs) ** 2)))) / m


@njit
def slide(m, f, fc, sigma, edge, vs, u, x, v, s, h):
    """One Runge-Kutta step of the sliding mode s."""
    a = rate(m, f, fc, sigma, edge, vs, u, v, s)
    b = rate(m, f, fc, sigma, edge, vs, u, v + 0.5 * h * a, s)
    c = rate(m, f, fc, sigma, edge, vs, u, v + 0.5 * h * b, s)
    d = rate(m, f, fc, sigma, edge, vs, u, v + h * c, s)
    return x + h * v + h * h / 6.0 * (a + b + c), v + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


@njit
def three_modes(m, f, fc, sigma, edge, vs, u, dt, true_x, true_v, window):
    """Oracle: modes -1, 0, +1 of theory, v = 0 located by bisection."""
    out = np.zeros(u.size)
    x, v, s = 0.0, 0.0, 0.0
    for k in range(u.size):
        if k % window == 0:
            x, v, s = true_x[k], true_v[k], np.sign(true_v[k])
        out[k] = x
        left = dt
        while left > 1e-15:
            if s == 0.0:
                if abs(u[k]) <= fc * (1.0 + sigma):
                    break
                s = np.sign(u[k])
            h = min(left, 0.5 * dt)
            new_x, new_v = slide(m, f, fc, sigma, edge, vs, u[k], x, v, s, h)
            if new_v * s < 0.0:
                low, high = 0.0, h
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    if slide(m, f, fc, sigma, edge, vs, u[k], x, v, s, middle)[1] * s < 0.0:
                        high = middle
                    else:
                        low = middle
                x, v = slide(m, f, fc, sigma, edge, vs, u[k], x, v, s, low)
                v, left = 0.0, left - low
                held = abs(u[k]) <= fc * (1.0 + sigma * exp(-((edge / vs) ** 2)))
                s = 0.0 if held else np.sign(u[k])
            else:
                x, v, left = new_x, new_v, left - h
    return out


FREE = Plant(mass=2.0, viscous=0.0, coulomb=0.0)


def start(x: float = 0.0, v: float = 0.0) -> np.ndarray:
    state = np.zeros(NSTATES)
    state[X] = state[XL] = x
    state[V] = state[VL] = v
    return state


def run(plant: Plant, u: np.ndarray, x: float = 0.0, v: float = 0.0, n: int = 40) -> np.ndarray:
    return open_loop(plant, np.asarray(u, dtype=float), DT, n, start(x, v))


class TestClosedForms:
    def test_coulomb_stop(self):
        """A sliding mass stops after v0^2 m/(2 Fc), and stays."""
        plant = Plant(mass=2.0, viscous=0.0, coulomb=8.0)
        states = run(plant, np.zeros(300), v=0.5)
        # One clipped substep of h = 25 us stops within a h^2 = 2.5e-9 m.
        assert states[-1, X] == pytest.approx(0.5**2 * 2.0 / (2.0 * 8.0), abs=2.5e-9)
        assert states[-1, V] == 0.0

    def test_viscous_and_coulomb_stop(self):
        """m v' = -f v - Fc: x = m v0/f - m Fc/f^2 log(1 + f v0/Fc)."""
        m, f, fc, v0 = 2.0, 15.0, 8.0, 0.4
        states = run(Plant(mass=m, viscous=f, coulomb=fc), np.zeros(400), v=v0)
        # Second order in h f/m = 2e-4: relative 1e-7 of 13 mm, and the clipped substep.
        want = m * v0 / f - m * fc / f**2 * log(1.0 + f * v0 / fc)
        assert states[-1, X] == pytest.approx(want, abs=6e-9)

    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_holds_up_to_breakaway(self, side):
        plant = Plant(coulomb=8.0, excess=0.25, stribeck_speed=0.01)
        held = run(plant, np.full(50, side * 9.999))
        assert not held[:, :4].any()
        assert held[-1, REST] == pytest.approx(0.05)
        moved = run(plant, np.full(50, side * 10.001))
        assert side * moved[-1, V] > 0.0

    def test_reverses_without_sticking(self):
        """Thrown against a force above breakaway: (u + Fc)/m, then (u - Fc)/m."""
        m, fc, u, v0, n = 2.0, 8.0, -20.0, 0.2, 100
        states = run(Plant(mass=m, viscous=0.0, coulomb=fc), np.full(n, u), v=v0)
        slow, fast = (u - fc) / m, (u + fc) / m
        stop = -v0 / slow
        rest = n * DT - stop
        # Linear in time on both sides: the split substep leaves a h^2 of position.
        assert states[-1, V] == pytest.approx(fast * rest, rel=1e-9)
        want = 0.5 * v0 * stop + 0.5 * fast * rest**2
        assert states[-1, X] == pytest.approx(want, abs=14.0 * (DT / 40) ** 2)

    def test_asymmetry_position_drift_load(self):
        """Breakaway follows Fc (1 + s a)(1 + p q + r q^2)(1 + rate t) + eta |w|."""
        plant = Plant(
            coulomb=8.0, asymmetry=0.1, slope=0.2, curvature=0.1, middle=0.1, half_travel=0.1,
            load=0.2,
        )  # fmt: skip
        q = 0.5
        level = 8.0 * 1.1 * (1.0 + 0.2 * q + 0.1 * q * q)
        edge = level / (1.0 - 0.2)  # |w| = level + 0.2 |w|
        assert run(plant, np.full(5, edge - 1e-6), x=0.15)[-1, V] == 0.0
        assert run(plant, np.full(5, edge + 1e-3), x=0.15)[-1, V] > 0.0
        drifting = Plant(coulomb=8.0, drift=-0.5)
        states = run(drifting, np.full(400, 7.0))
        first = np.flatnonzero(states[:, V] > 0.0)[0] * DT
        assert first == pytest.approx(0.25, abs=2 * DT)  # 8 (1 - t/2) = 7

    def test_spring_frequency_and_energy(self):
        """Undamped: the period is 2 pi sqrt(m/k) and the energy stays."""
        m, k = 2.0, 5000.0
        plant = FREE._replace(mass=m, spring=k, spring_centre=0.1)
        n = round(20 * 2.0 * pi * sqrt(m / k) / DT)
        states = run(plant, np.zeros(n), x=0.11)
        t = np.arange(n + 1) * DT
        # 20 periods, phase error (omega h)^2/24 of 126 rad: 9e-6 of the amplitude.
        want = 0.1 + 0.01 * np.cos(sqrt(k / m) * t)
        assert np.abs(states[:, X] - want).max() < 2e-7
        energy = 0.5 * m * states[:, V] ** 2 + 0.5 * k * (states[:, X] - 0.1) ** 2
        assert np.ptp(energy) / energy[0] < 1e-5

    def test_friction_never_feeds_energy(self):
        """Left alone on a spring, every kind of friction only takes energy."""
        k = 5000.0
        for extra in (
            {},
            {"excess": 0.3, "stribeck_speed": 0.02},
            {"dwell_rise": 3.0, "dwell_time": 0.1},
            {"asymmetry": 0.2},
            {"slope": 0.3, "half_travel": 0.1},
        ):
            plant = Plant(viscous=0.0, coulomb=8.0, spring=k)._replace(**extra)
            states = run(plant, np.zeros(400), x=0.02)
            energy = 0.5 * plant.mass * states[:, V] ** 2 + 0.5 * k * states[:, X] ** 2
            assert np.diff(energy).max() < 1e-6 * energy[0]  # the scheme's own ripple
            # Each half swing takes 2 Fc/k = 3.2 mm off the amplitude of 20 mm, until
            # it rests where the spring is weaker than breakaway.
            assert states[-1, V] == 0.0 and energy[-1] < 0.1 * energy[0]

    def test_stribeck_level_while_sliding(self):
        """At constant speed the force is Fc (1 + sigma exp(-((v - Sigma)/vs)^2))."""
        v = 0.012
        level = 8.0 * (1.0 + 0.4 * exp(-(((v - 1e-4) / 0.01) ** 2)))
        plant = Plant(viscous=0.0, coulomb=8.0, excess=0.4, stribeck_speed=0.01)
        states = run(plant, np.full(2, level), v=v)
        assert states[-1, V] == pytest.approx(v, rel=1e-12)

    def test_drag_gravity_cogging_ripple_forces(self):
        """One force at a time balances the input that it should."""
        for extra, x, v, force in (
            ({"drag": 3.0}, 0.0, 0.5, 0.75),
            ({"drag": 3.0}, 0.0, -0.5, -0.75),
            ({"gravity": 5.0, "gravity_phase": 0.2}, 0.3, 0.0, 5.0 * np.sin(0.5)),
            ({"cogging": 2.0, "cogging_pitch": 0.04}, 0.01, 0.0, -2.0),
            ({"bias": 1.5}, 0.0, 0.0, -1.5),
            ({"spring": 50.0, "spring_centre": 0.1}, 0.3, 0.0, 10.0),
            ({"stop_stiffness": 400.0, "stop_place": 0.2}, 0.3, 0.0, 4.0),
        ):
            states = run(FREE._replace(**extra), np.full(1, force), x=x, v=v, n=1000)
            # One millisecond: what is left is the change of the force under way.
            assert states[1, V] - v == pytest.approx(0.0, abs=2e-6)

    def test_time_periodic(self):
        """A free mass under A sin(w t): v = A/(m w) (1 - cos w t)."""
        plant = FREE._replace(periodic=3.0, periodic_frequency=5.0)
        states = run(plant, np.zeros(200))
        w = 2.0 * pi * 5.0
        t = np.arange(201) * DT
        want = 3.0 / (2.0 * w) * (1.0 - np.cos(w * t))
        assert np.abs(states[:, V] - want).max() < 1e-8  # midpoint rule, (w h)^2/24


class TestDrive:
    @pytest.mark.parametrize("delay", [0.0, 1e-3, 2.5e-3, 3.37e-3])
    def test_delay_is_exact(self, delay):
        """A step of force at 10 ms moves a free mass as from 10 ms + delay."""
        u = np.zeros(40)
        u[10:] = 4.0
        states = run(FREE._replace(delay=delay), u)
        t = np.arange(41) * DT
        run_time = np.maximum(t - 0.010 - delay, 0.0)
        assert np.allclose(states[:, V], 2.0 * run_time, atol=1e-12)
        # A substep that the step falls into averages it: a h^2/8 of position.
        assert np.abs(states[:, X] - run_time**2).max() < 2.0 * (DT / 40) ** 2 / 8 + 1e-12

    def test_lag_is_exact(self):
        """Behind a lag tau the impulse of a unit step is t - tau (1 - e^(-t/tau))."""
        tau = 4e-3
        states = run(FREE._replace(lag=tau), np.full(30, 1.0))
        t = np.arange(31) * DT
        want = (t - tau * (1.0 - np.exp(-t / tau))) / 2.0
        assert np.allclose(states[:, V], want, atol=1e-12)
        assert np.allclose(states[:, LAG], 1.0 - np.exp(-t / tau), atol=1e-12)

    def test_gain_dead_zone_saturation(self):
        for extra, u, force in (
            ({"gain": 1.2}, 5.0, 6.0),
            ({"dead_zone": 2.0}, -5.0, -3.0),
            ({"dead_zone": 2.0}, 1.5, 0.0),
            ({"saturation": 4.0}, -5.0, -4.0),
        ):
            states = run(FREE._replace(**extra), np.full(10, u))
            assert states[-1, V] == pytest.approx(force / 2.0 * 0.01, abs=1e-12)


class TestMechanisms:
    def test_dwell(self):
        """Breakaway grows as Fs + rise (1 - exp(-T/tau)) with the time at rest."""
        plant = Plant(coulomb=8.0, dwell_rise=4.0, dwell_time=0.2)
        ramp = np.concatenate((np.zeros(300), np.linspace(0.0, 16.0, 1600)))
        states = run(plant, ramp)
        k = int(np.flatnonzero(states[:, V] > 0.0)[0]) - 1
        want = 8.0 + 4.0 * (1.0 - exp(-k * DT / 0.2))
        assert ramp[k] == pytest.approx(want, abs=0.02)  # the ramp's step is 0.01 N
        assert states[k + 1, REST] == 0.0

    def test_presliding_spring_and_slip(self):
        """Below Fc it is a spring of Fc/distance; above, plain Coulomb friction."""
        d, fc, m = 50e-6, 8.0, 2.0
        plant = Plant(mass=m, viscous=200.0, coulomb=fc, presliding=d)
        rest = run(plant, np.full(1500, 4.0))
        assert rest[-1, X] == pytest.approx(0.5 * d, rel=1e-6)
        back = run(plant, np.concatenate((np.full(1500, 4.0), np.zeros(1500))))
        assert abs(back[-1, X]) < 1e-9  # elastic: it returns
        slip = run(plant, np.full(3000, 10.0))
        assert slip[-1, V] == pytest.approx((10.0 - fc) / 200.0, rel=1e-6)
        assert slip[-1, Z] == pytest.approx(d, rel=1e-12)

    def test_compliance_resonance(self):
        """Two free masses swing against each other at sqrt(k/m_r)."""
        share, m, w = 0.4, 2.0, 150.0
        reduced = m * share * (1.0 - share)
        plant = FREE._replace(load_fraction=share, coupling_stiffness=reduced * w**2)
        state = start()
        state[X] = 1e-3
        states = open_loop(plant, np.zeros(400), DT, 40, state)
        t = np.arange(401) * DT
        apart = states[:, X] - states[:, XL]
        # 60 rad of phase, error (w h)^2/24 of it.
        assert np.abs(apart - 1e-3 * np.cos(w * t)).max() < 1e-7
        centre = (1.0 - share) * states[:, X] + share * states[:, XL]
        assert np.ptp(centre) < 1e-15

    def test_backlash_gap_and_momentum(self):
        """The motor crosses the gap alone, then both go on together."""
        share, m, gap = 0.5, 2.0, 2e-4
        stiffness = 1e7
        damping = 2.0 * 0.7 * sqrt(stiffness * m * share * (1.0 - share))
        plant = FREE._replace(
            load_fraction=share, gap=gap, coupling_stiffness=stiffness, coupling_damping=damping
        )
        states = open_loop(plant, np.full(60, 1.0), DT, 120, start())
        t = np.arange(61) * DT
        alone = 0.5 * t**2 / (m * (1.0 - share))
        free = alone < 0.5 * gap
        assert np.allclose(states[free, X], alone[free], atol=1e-12)
        assert not states[free, XL].any()
        momentum = m * (1.0 - share) * states[:, V] + m * share * states[:, VL]
        assert np.allclose(momentum, t, atol=1e-12)
        # Contact keeps them half a gap apart, plus 0.5 N on the contact's spring.
        assert states[-1, X] - states[-1, XL] == pytest.approx(0.5 * gap, abs=2e-7)

    def test_backlash_friction_is_on_the_load(self):
        """Inside the gap nothing but the motor's own mass resists."""
        plant = Plant(
            mass=2.0, viscous=0.0, coulomb=8.0, load_fraction=0.5, gap=1e-3,
            coupling_stiffness=1e7, coupling_damping=3e3,
        )  # fmt: skip
        states = open_loop(plant, np.full(20, 1.0), DT, 120, start())
        assert states[-1, V] == pytest.approx(0.02, abs=1e-12)
        touching = start()
        touching[X] = 5e-4
        pressed = open_loop(plant, np.full(500, 4.0), DT, 120, touching)
        assert pressed[-1, XL] == 0.0  # held by the load's friction, 8 N
        assert pressed[-1, X] - 5e-4 == pytest.approx(4.0 / 1e7, rel=1e-6)


class TestBench:
    @pytest.mark.parametrize("condition", CONDITIONS)
    def test_same_seed_same_record(self, condition):
        first, again = make_case("cogging", 5, condition), make_case("cogging", 5, condition)
        for name in ("t", "u", "x", "reference", "states"):
            assert np.array_equal(getattr(first, name), getattr(again, name))
        assert first.truth == again.truth and first.believed == again.believed
        other = make_case("cogging", 6, condition)
        assert not np.array_equal(first.u, other.u)

    @pytest.mark.parametrize("slug", EFFECTS + OUTSIDE)
    def test_every_effect_is_seen_and_tame(self, slug):
        case = make_case(slug, 11, "short")
        assert np.isfinite(case.u).all() and np.isfinite(case.states).all()
        assert set(case.truth) == {slug}
        assert case.visibility[slug] >= (LOUD if slug in OUTSIDE else VISIBLE)
        span = case.believed["travel"][1]
        assert case.x.min() > -0.05 * span and case.x.max() < 1.05 * span
        assert np.median(np.abs(case.x - case.reference)) < 0.05 * span

    def test_believed(self):
        for seed in range(3):
            exact, off = make_null(seed), make_null(seed, "off")
            assert exact.believed == exact.actual
            for key in ("mass", "viscous", "coulomb"):
                share = off.believed[key] / off.actual[key] - 1.0
                assert 0.0 < abs(share) <= 0.031  # 3 % of the true value, as a ratio
        case = make_case("coulomb", 0, "off")
        assert case.truth["coulomb"]["coulomb"] == case.actual["coulomb"]
        assert abs(case.actual["coulomb"] / case.believed["coulomb"] - 1.0) > 0.05
        assert make_case("stribeck", 0).believed["stribeck"] is None

    @pytest.mark.parametrize("condition", ["exact", "coarse", "short"])
    def test_null_replays_at_the_floor(self, condition):
        """An event-located three-mode replay meets the record to a tenth of a quantum."""
        for seed in range(4):
            case = make_null(seed, condition)
            peak = case.actual["stribeck"] or {"excess": 0.0, "speed": 1.0}
            x = three_modes(
                case.actual["mass"], case.actual["viscous"], case.actual["coulomb"],
                peak["excess"], case.actual["stick_speed"], peak["speed"],
                case.u, DT, case.states[:, X].copy(), case.states[:, V].copy(), WINDOW,
            )  # fmt: skip
            if case.noise == 0.0:
                assert np.abs(case.x - case.states[:, X]).max() <= 0.5 * case.quantum * (1 + 1e-9)
            n = x.size // WINDOW * WINDOW
            error = ((x - case.states[:, X])[:n] / case.quantum).reshape(-1, WINDOW)
            # Rounding alone is 0.29 of a quantum; what the substeps add must vanish
            # beside it even where a falling Stribeck curve magnifies it.
            assert np.sqrt(np.mean(error**2, axis=1)).max() < 0.1

    def test_pairs(self):
        seen = set()
        for seed in range(8):
            case = make_pair(seed, "short")
            pair = frozenset(case.truth)
            assert len(pair) == 2 and pair not in EQUAL
            assert min(case.visibility.values()) >= VISIBLE
            seen.add(pair)
        assert len(seen) > 5

    @pytest.mark.parametrize("how", RECORDERS)
    def test_recorder_changes_only_what_is_written_down(self, how):
        for seed in (0, 1):
            sound, poor = make_case("spring", seed), make_case("spring", seed, how)
            assert poor.truth == sound.truth and poor.condition == how
            assert poor.t.size == poor.u.size == poor.x.size == poor.states.shape[0]
            level, n = sound.actual["coulomb"], sound.t.size
            if how == "noisy":
                assert np.std(poor.u - sound.u) == pytest.approx(0.03 * level, rel=0.02)
            elif how == "10-bit":
                assert np.unique(poor.u).size <= 1024
                assert np.abs(poor.u - sound.u).max() <= 0.5001 * np.ptp(sound.u) / 1023.0
            elif how == "decimated":
                assert np.diff(poor.t) == pytest.approx(4.0 * DT)
                impulse = np.sum(poor.u) * 4.0 - np.sum(sound.u)
                assert (abs(impulse) < 1e-6) == (seed == 0)
            elif how == "jitter":
                steps = np.diff(poor.t)
                assert np.all(steps > 0.69 * DT) and np.all(steps < 4.31 * DT)
                assert 0.003 < 1.0 - poor.t.size / n < 0.008
                # Late readings lie on the true path where it is at the stamped time.
                place = np.interp(poor.t, sound.t, sound.states[:, X])
                late = np.median(np.abs(poor.x - place)) / poor.quantum
                assert (late < 1.0) == (seed == 0)
            else:
                changed = np.abs(poor.x - sound.x)
                assert 0.0005 < np.mean(changed > 0.0015 * np.ptp(sound.x)) < 0.002
                assert np.array_equal(poor.u, sound.u)

    def test_machine(self):
        counts = set()
        for seed in range(3):
            runs = make_machine(seed)
            first = runs[0]
            counts.add(len(first.truth))
            assert len(runs) == 3 and all(r.truth == first.truth for r in runs)
            assert all(7.0 <= r.t.size * DT <= 9.0 for r in runs)
            assert all(r.believed == first.believed and r.plant == first.plant for r in runs)
            shares = {round(first.believed[k] / first.actual[k] - 1.0, 9) for k in
                      ("mass", "viscous", "coulomb")}  # fmt: skip
            assert shares == {-0.2, 0.2}
            for slug in first.truth:
                assert np.mean([r.visibility[slug] for r in runs]) >= VISIBLE
        assert counts <= {2, 3, 4} and len(counts) > 1
        assert not make_machine(0, 0)[0].truth
        assert set(make_machine(0, ("spring", "drift"))[1].truth) == {"spring", "drift"}

    def test_twins_are_the_same_record(self):
        """A bias without a Stribeck peak is an asymmetry: F = s Fc + b either way."""
        seed = next(s for s in range(20) if make_case("bias_force", s).twins)
        case = make_case("bias_force", seed)
        share = -case.truth["bias_force"]["force"] / case.actual["coulomb"]
        twin = case.plant._replace(bias=0.0, asymmetry=share)
        x = free_runs(twin, case.u, DT, case.substeps, case.states, WINDOW)
        assert np.abs(x - case.states[:, X]).max() < 1e-3 * case.quantum


def test_shares_no_code_with_the_package():
    """No import of the package by the generator or by the baseline."""
    root = Path(__file__).parent
    sources = [*(root / "truth").glob("*.py"), root.parent / "benchmarks/diagnosis_baseline.py"]
    assert len(sources) == 7
    for source in sources:
        text = source.read_text()
        assert "import dryfric_control" not in text and "from dryfric_control" not in text
