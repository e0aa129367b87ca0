"""How fast and how exact the simulation is, against everything it could be done with.

Run ``python benchmarks/simulation.py``; one run prints every table. Times are processor
times, the best and the median of several repetitions taken in turns, compiled code warmed
up; nothing here uses more than one thread. Errors are against a tight solution of the same law,
stated with each table. Name tables to print only those: samples effects structures
stickslip servo memory compile.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import control as ct
import numpy as np
import pictures
import servo_peers
import simulation_peers as peers

import dryfric_control as dfc

DT = 1e-3
ROOT = Path(__file__).resolve().parent.parent


Work = Callable[[], object]


def race(works: list[Work], repeat: int) -> list[tuple[float, float, object]]:
    """Best and median processor time [s] and result of each work, timed in turns.

    Processor time and turns, because a busy machine would otherwise stretch long work
    more than short, and one minute more than the next. The first call of each only warms
    up, but for work of more than 20 s, which has no other; work of more than 0.2 s is timed once.
    """
    results = []
    times: list[list[float]] = [[] for _ in works]
    for work, mine in zip(works, times, strict=True):
        begin = time.process_time()
        results.append(work())
        if time.process_time() - begin > 20.0:
            mine.append(time.process_time() - begin)
    for _ in range(repeat):
        for work, mine in zip(works, times, strict=True):
            if not mine or mine[0] < 0.2:
                begin = time.process_time()
                work()
                mine.append(time.process_time() - begin)
    return [
        (min(mine), float(np.median(mine)), result)
        for mine, result in zip(times, results, strict=True)
    ]


def heading(text: str) -> None:
    print(f"\n{text}\n{'-' * len(text)}")


# --- 1 and 6: cost of a sample and of an effect ---------------------------------------


def samples_table(repeat: int) -> None:
    """Time of one 1 ms sample for a handful of axes."""
    heading("One 1 ms sample of FrictionAxis.simulate, 100,000 samples")
    t = np.arange(100_000) * DT
    sine = 3.0 * np.sin(2 * np.pi * 0.5 * t)
    plain = {"mass": 1.0, "viscous": 0.4, "coulomb": 1.0}
    shaped = {
        "mass": 1.0,
        "viscous": 0.4,
        "coulomb": dfc.CoulombMap(plus=[1.0, 0.05, 0.02, -0.01], minus=[1.1, -0.04, 0.01, 0.01]),
        "travel": (-1.0, 1.0),
        "stribeck": dfc.Stribeck(excess=0.3, speed=0.01),
    }
    three = (
        dfc.effects.Spring(stiffness=2.0),
        dfc.effects.Cogging(amplitude=0.1, period=0.01),
        dfc.effects.BiasForce(force=0.1),
    )
    problem = peers.StickSlip()
    rows = [
        ("constant Coulomb level", dfc.FrictionAxis(**plain), sine, "zero"),
        ("cubic maps, Stribeck peak", dfc.FrictionAxis(**shaped), sine, "zero"),
        ("the same, 3 effects", dfc.FrictionAxis(**shaped, effects=three), sine, "zero"),
        ("at rest", dfc.FrictionAxis(**plain), 0.2 * sine, "zero"),
        ("stick-slip on a spring", pulled_axis(problem), 0.2 * t, "first"),
    ]
    print(f"{'axis':30s} {'ns min':>8s} {'median':>8s} {'switches':>9s} {'sliding':>8s}")
    found = race(
        [lambda a=axis, u=u, h=hold: a.simulate(u, DT, hold=h) for _, axis, u, hold in rows],
        repeat,
    )
    for (name, *_), (best, median, run) in zip(rows, found, strict=True):
        sliding = np.mean(run.mode != 0)
        print(
            f"{name:30s} {best / t.size * 1e9:8.1f} {median / t.size * 1e9:8.1f} "
            f"{len(run.events):9d} {sliding:8.0%}"
        )


def effects_table(repeat: int) -> None:
    """Time that one effect adds to a sample while sliding."""
    heading("Cost of one effect, ns a sample, sliding all the time (100,000 samples)")
    base = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=1.0)
    u = np.full(100_000, 1.5)
    effects = [
        dfc.effects.BiasForce(force=0.01),
        dfc.effects.ViscousAsymmetry(viscous=0.01),
        dfc.effects.CoulombAsymmetry(force=0.01),
        dfc.effects.QuadraticDrag(drag=0.01),
        dfc.effects.Spring(stiffness=1e-3),
        dfc.effects.Gravity(amplitude=0.01),
        dfc.effects.Cogging(amplitude=0.01, period=1.0),
        dfc.effects.InputDelay(delay=2.3e-3),
        dfc.effects.InputGain(gain=0.99),
        dfc.effects.DeadZone(width=0.01),
    ]
    axes = [base, *(base.replace(effects=(effect,)) for effect in effects)]
    found = race([lambda a=axis: a.simulate(u, DT, v0=0.1) for axis in axes], 3 * repeat)
    alone = found[0][0]
    print(f"without effects {alone / u.size * 1e9:.1f}")
    for effect, (best, _, run) in zip(effects, found[1:], strict=True):
        assert np.all(run.mode == 1)
        print(f"{effect.slug:20s} {(best - alone) / u.size * 1e9:+7.1f}")


def structures_table(repeat: int) -> None:
    """Time of a sample with a contact or a transmission, by what the axis does."""
    heading("Presliding, backlash, compliance: ns a 1 ms sample (100,000 samples)")
    n = 100_000
    t = np.arange(n) * DT
    base = dfc.FrictionAxis(mass=2.0, viscous=6.0, coulomb=8.0)
    structures = {
        "rigid": (),
        "presliding": (dfc.effects.Presliding(distance=40e-6),),
        "backlash": (dfc.effects.Backlash(gap=2e-4, load_fraction=0.4),),
        "compliance": (dfc.effects.Compliance(stiffness=3e4, damping=12.0, load_fraction=0.4),),
    }
    duties = {
        "sliding": np.full(n, 12.0),
        "holding": np.full(n, 4.0),
        "to and fro": 20.0 * np.sin(2 * np.pi * t),
    }
    axes = [base.replace(effects=effects) for effects in structures.values()]
    works: list[Work] = [
        lambda axis=axis, u=u: axis.simulate(u, DT) for axis in axes for u in duties.values()
    ]
    # A play as wide as the way: the motor rocks between its ends and never arrives.
    wide = base.replace(effects=(dfc.effects.Backlash(gap=10.0, load_fraction=0.4),))
    works.append(lambda: wide.simulate(np.where(t % 0.4 < 0.2, 1.0, -1.0), DT))
    found = [best / n * 1e9 for best, _, _ in race(works, repeat)]
    print(f"{'':12s}" + "".join(f"{duty:>12s}" for duty in duties))
    for i, name in enumerate(structures):
        print(f"{name:12s}" + "".join(f"{ns:12.1f}" for ns in found[3 * i : 3 * i + 3]))
    print(f"in the play, without contact: {found[-1]:.1f}")


# --- 2: the free stick-slip run -------------------------------------------------------


def pulled_axis(problem: peers.StickSlip) -> dfc.FrictionAxis:
    """The axis of the stick-slip problem."""
    return dfc.FrictionAxis(
        mass=problem.mass,
        viscous=0.0,
        coulomb=problem.coulomb,
        stribeck=dfc.Stribeck(excess=problem.excess, speed=problem.stribeck_speed),
        stick_speed=problem.stick_speed,
        stick_rate=problem.stick_rate,
        effects=(dfc.effects.Spring(stiffness=problem.stiffness),),
    )


def pulled(problem: peers.StickSlip, dt: float, law: dfc.laws.Law | None = None) -> peers.Breaks:
    """Our run of the stick-slip problem; the spring's end moves linearly."""
    u = problem.stiffness * problem.belt * np.arange(round(problem.duration / dt) + 1) * dt
    run = pulled_axis(problem).simulate(u, dt, hold="first", law=law)
    if law is None:
        return peers.Breaks(run.events.times(0, 1), np.empty(0))
    x, v, force, _ = run.y
    return peers.Breaks(np.empty(0), peers.slips_of_samples(problem, run.t, x, v, force))


def worst(found: np.ndarray, exact: np.ndarray) -> float:
    """Largest error of the transition times; infinite if one is missing or too many."""
    return float(np.abs(found - exact).max()) if found.size == exact.size else np.inf


def stick_slip_table(repeat: int, plot: Path | None = None) -> None:
    """40 s of stick-slip: time against accuracy of the transitions."""
    p = peers.StickSlip()
    heading("40 s of stick-slip, five breakaways")
    print(
        "error: largest error of the five transition times against the same law's own tight\n"
        "solution (switched: instants of breakaway, DOP853 1e-13; LuGre, tanh, linear: velocity\n"
        "rising through 10 mm/s, Radau 1e-11; nosnoc, MuJoCo: the same, of the switched model).\n"
        "limit: the same against the switched model. inf: not five."
    )
    lugre, tanh, linear = peers.lugre_rates(p), peers.tanh_rates(p), peers.linear_rates(p)
    exact = peers.events_dop853(p, 1e-13)
    truth = {
        "switched": exact.modes,
        "lugre": peers.smooth_solve_ivp(p, lugre, 3, "Radau", 1e-11).slips,
        "tanh": peers.smooth_solve_ivp(p, tanh, 2, "Radau", 1e-11).slips,
        "linear": peers.smooth_solve_ivp(p, linear, 2, "Radau", 1e-11).slips,
        "slips": exact.slips,
    }
    our_lugre = dfc.laws.LuGre(stiffness=1e5, damping=300.0)
    our_tanh = dfc.laws.Tanh(speed=1e-5)
    cases: list[tuple[str, str, Callable[[], peers.Breaks]]] = [
        ("ours, 1 ms samples", "switched", lambda: pulled(p, DT)),
        ("ours, 10 ms samples", "switched", lambda: pulled(p, 0.01)),
        ("ours, 100 ms samples", "switched", lambda: pulled(p, 0.1)),
        ("events, DOP853 compiled 1e-6", "switched", lambda: peers.events_dop853(p, 1e-6)),
        ("events, DOP853 compiled 1e-8", "switched", lambda: peers.events_dop853(p, 1e-8)),
        ("events, DOP853 compiled 1e-10", "switched", lambda: peers.events_dop853(p, 1e-10)),
        (
            "events, solve_ivp RK45 1e-6",
            "switched",
            lambda: peers.events_solve_ivp(p, "RK45", 1e-6),
        ),
        (
            "events, solve_ivp RK45 1e-10",
            "switched",
            lambda: peers.events_solve_ivp(p, "RK45", 1e-10),
        ),
        (
            "events, solve_ivp DOP853 1e-8",
            "switched",
            lambda: peers.events_solve_ivp(p, "DOP853", 1e-8),
        ),
        (
            "events, solve_ivp LSODA 1e-10",
            "switched",
            lambda: peers.events_solve_ivp(p, "LSODA", 1e-10),
        ),
        ("compiled Euler, 1 ms", "switched", lambda: peers.euler_loop(p, 1e-3)),
        ("compiled Euler, 10 µs", "switched", lambda: peers.euler_loop(p, 1e-5)),
        ("ours, LuGre 1e-8, 1 ms", "lugre", lambda: pulled(p, DT, our_lugre)),
        ("LuGre, LSODA 1e-6", "lugre", lambda: peers.smooth_solve_ivp(p, lugre, 3, "LSODA", 1e-6)),
        ("LuGre, LSODA 1e-8", "lugre", lambda: peers.smooth_solve_ivp(p, lugre, 3, "LSODA", 1e-8)),
        (
            "LuGre, LSODA 1e-10",
            "lugre",
            lambda: peers.smooth_solve_ivp(p, lugre, 3, "LSODA", 1e-10),
        ),
        ("LuGre, Radau 1e-6", "lugre", lambda: peers.smooth_solve_ivp(p, lugre, 3, "Radau", 1e-6)),
        ("LuGre, odeint 1e-8", "lugre", lambda: peers.smooth_odeint(p, lugre, 3, 1e-8)),
        (
            "LuGre, python-control LSODA 1e-6",
            "lugre",
            lambda: peers.control_response(p, lugre, 3, "LSODA", 1e-6),
        ),
        (
            "LuGre, python-control defaults",
            "lugre",
            lambda: peers.control_response(p, lugre, 3, "RK45", 1e-3),
        ),
        ("ours, tanh 1e-8, 1 ms", "tanh", lambda: pulled(p, DT, our_tanh)),
        ("tanh, LSODA 1e-6", "tanh", lambda: peers.smooth_solve_ivp(p, tanh, 2, "LSODA", 1e-6)),
        ("tanh, LSODA 1e-8", "tanh", lambda: peers.smooth_solve_ivp(p, tanh, 2, "LSODA", 1e-8)),
        ("tanh, Radau 1e-6", "tanh", lambda: peers.smooth_solve_ivp(p, tanh, 2, "Radau", 1e-6)),
        ("tanh, odeint 1e-8", "tanh", lambda: peers.smooth_odeint(p, tanh, 2, 1e-8)),
    ]
    folder = tempfile.TemporaryDirectory()
    if peers.fmu_available():
        fmu = peers.regularised_fmu(p, Path(folder.name))
        cases += [
            (
                f"linear, FMU by CVode {rtol}",
                "linear",
                lambda r=rtol: peers.fmu_cvode(p, fmu, float(r)),
            )
            for rtol in ("1e-6", "1e-8", "1e-10")
        ]
    else:
        print("fmpy or gcc is not installed: the rows of the FMU are left out")
    if peers.nosnoc is None:
        print("nosnoc is not installed: its row is left out")
    else:
        cases.append(("nosnoc, FESD, 20 ms", "slips", lambda: peers.fesd(p)))
    if peers.mujoco is None:
        print("MuJoCo is not installed: its rows are left out")
    else:
        default = "0.9 0.95 0.001 0.5 2"
        cases += [
            (
                "MuJoCo, its defaults, 1 ms",
                "slips",
                lambda: peers.mujoco_slide(p, 1e-3, "0.02 1", default),
            ),
            ("MuJoCo, stiff solimp, 1 ms", "slips", lambda: peers.mujoco_slide(p, 1e-3, "0.02 1")),
            (
                "MuJoCo, stiff solimp, 0.1 ms",
                "slips",
                lambda: peers.mujoco_slide(p, 1e-4, "0.02 1"),
            ),
        ]
    print(f"{'':34s} {'ms min':>9s} {'median':>9s} {'error s':>9s} {'limit s':>9s} {'x ours':>8s}")
    done = []
    raced = race([work for _, _, work in cases], repeat)
    for (name, law, _), (best, median, found) in zip(cases, raced, strict=True):
        own = found.modes if law == "switched" else found.slips
        error = worst(own, truth[law])
        limit = error if law == "switched" else worst(found.slips, truth["slips"])
        done.append((name, law, best, error))
        print(
            f"{name:34s} {best * 1e3:9.2f} {median * 1e3:9.2f} {error:9.1e} {limit:9.1e} "
            f"{best / done[0][2]:8.2f}"
        )
    _, _, ours, error = done[0]
    exact_peers = [
        row for row in done if row[1] == "switched" and row[3] <= error and "ours" not in row[0]
    ]
    if exact_peers:
        name, _, best, _ = min(exact_peers, key=lambda row: row[2])
        print(
            f"fastest peer at least as exact as ours at 1 ms: {name}, {best / ours:.1f} x our time"
        )
    if plot:
        laws = {
            "switched": "switched model",
            "lugre": "LuGre",
            "tanh": "tanh",
            "linear": "regularised (Modelica style)",
            "slips": "against the switched model",
        }
        pictures.work_precision(done, laws, plot)
    folder.cleanup()
    sampled_block_row(p, ours)


def sampled_block_row(problem: peers.StickSlip, ours: float) -> None:
    """python-control's response of our sampled block, against the compiled run."""
    axis = pulled_axis(problem)
    t = np.arange(round(problem.duration / DT) + 1) * DT
    u = problem.stiffness * problem.belt * t
    block = dfc.axis_block(axis, dt=DT)
    begin = time.process_time()
    found = ct.input_output_response(block, t, u)
    spent = time.process_time() - begin
    same = axis.simulate(u, DT)
    gap = np.abs(found.outputs[:2] - same.y[:2]).max()
    print(
        f"python-control's response of axis_block, held input: {spent * 1e3:.0f} ms, "
        f"{spent / ours:.0f} x our time, within {gap:.1e} of simulate()"
    )


# --- 3: the sampled servo loop --------------------------------------------------------


def servo_table(repeat: int) -> None:
    """A 1 ms position loop on an encoder, switching inside samples."""
    p = servo_peers.Servo()
    exact, modes = servo_peers.servo_solve_ivp(p, "DOP853", 1e-12, 2.5e-4)
    heading("1 ms servo loop, PD controller, encoder, held input")
    print(
        f"{modes.size} samples, {np.count_nonzero(np.diff(modes))} switches; error: largest of x "
        "at the samples against\nsolve_ivp DOP853 1e-12"
    )
    axis = dfc.FrictionAxis(
        mass=p.mass,
        viscous=p.viscous,
        coulomb=p.coulomb,
        stribeck=dfc.Stribeck(excess=p.excess, speed=p.stribeck_speed),
        stick_speed=p.stick_speed,
        stick_rate=p.stick_rate,
    )
    loop = dfc.PositionController(kp=p.kp, ki=0.0, kd=p.kd, dt=p.dt)
    reference = p.reference

    def compiled():
        return dfc.simulate_loop(axis, loop, reference, quantum=p.quantum).y[0], None

    def stepped():
        plant = axis.stepper(p.dt)
        x = np.empty(reference.size)
        last = 0.0
        for k, r in enumerate(reference.tolist()):
            x[k] = plant.x
            y = p.quantum * np.floor(plant.x / p.quantum + 0.5)
            plant.step(p.kp * (r - y) - p.kd * (y - last) / p.dt)
            last = y
        return x, None

    cases = [
        ("ours, simulate_loop", compiled),
        ("ours, stepper() in a Python loop", stepped),
        ("solve_ivp RK45 1e-8", lambda: servo_peers.servo_solve_ivp(p, "RK45", 1e-8)),
        ("DOP853 compiled 1e-8", lambda: servo_peers.servo_dop853(p, 1e-8)),
        ("hand-written RK4, 1 substep", lambda: servo_peers.servo_rk4(p, 1)),
        ("hand-written RK4, 2 substeps", lambda: servo_peers.servo_rk4(p, 2)),
        ("hand-written RK4, 4 substeps", lambda: servo_peers.servo_rk4(p, 4)),
        ("compiled Euler", lambda: servo_peers.servo_euler(p, 1)),
        ("compiled Euler, 100 substeps", lambda: servo_peers.servo_euler(p, 100)),
    ]
    if peers.mujoco is None:
        print("MuJoCo is not installed: its rows are left out")
    else:
        cases.append(("MuJoCo, stiff solimp", lambda: servo_peers.servo_mujoco(p, 1, "0.02 1")))
    print(f"{'':34s} {'us/sample':>9s} {'median':>9s} {'error m':>9s} {'x ours':>8s}")
    done = []
    raced = race([work for _, work in cases], repeat)
    for (name, _), (best, median, (x, _)) in zip(cases, raced, strict=True):
        error = np.abs(x - exact).max()
        done.append((name, best, error))
        print(
            f"{name:34s} {best / x.size * 1e6:9.3f} {median / x.size * 1e6:9.3f} {error:9.1e} "
            f"{best / done[0][1]:8.1f}"
        )
    for kind, by_hand in (("library", False), ("hand-written loop", True)):
        name, best, _ = min(
            (
                row
                for row in done
                if row[2] <= done[0][2]
                and "ours" not in row[0]
                and row[0].startswith("hand-written") == by_hand
            ),
            key=lambda row: row[1],
        )
        print(
            f"fastest {kind} at least as exact as ours: {name}, {best / done[0][1]:.1f} x our time"
        )


# --- 4 and 5: memory and compilation, each in a process of its own --------------------

MEMORY = """
import json, resource
import numpy as np
import dryfric_control as dfc

axis = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=1.0,
                        stribeck=dfc.Stribeck(excess=0.3, speed=0.01))
axis.simulate(np.ones(1000), 1e-3)
u = np.arange(10_000_000.0)
u *= 3e-3
np.sin(u, out=u)
u *= 3.0
# Resident now, not the highest so far: compiling has been higher (Linux).
before = int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() // 1024
run = axis.simulate(u, 1e-3)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
arrays = {id(a.base if a.base is not None else a): a.base if a.base is not None else a
          for a in (run.t, run.y, run.u, run.events.time, run.events.before, run.events.after)}
print(json.dumps({"peak": (after - before) * 1024,
                  "arrays": sum(a.nbytes for a in arrays.values()),
                  "switches": len(run.events)}))
"""

COMPILE = """
import json, time
spent = {}
def lap(name, work):
    begin = time.process_time()
    work()
    spent[name] = time.process_time() - begin
def load():
    global dfc, np
    import numpy as np
    import dryfric_control as dfc
lap("import", load)
u = 3.0 * np.sin(np.arange(100) * 0.05)
axis = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=1.0)
lap("simulate", lambda: axis.simulate(u, 1e-3))
three = axis.replace(effects=(dfc.effects.Spring(stiffness=1.0), dfc.effects.BiasForce(force=0.1),
                              dfc.effects.Cogging(amplitude=0.1, period=0.1)))
lap("three effects", lambda: three.simulate(u, 1e-3))
loop = dfc.PositionController(kp=400.0, ki=0.0, kd=20.0, dt=1e-3)
lap("simulate_loop", lambda: dfc.simulate_loop(axis, loop, u))
lap("sign, Karnopp", lambda: axis.simulate(u, 1e-3, law=dfc.laws.Karnopp(band=1e-4)))
lap("tanh, Dahl, LuGre", lambda: axis.simulate(u, 1e-3, law=dfc.laws.Dahl(stiffness=1e4)))
print(json.dumps(spent))
"""


def in_process(code: str, **environment: str) -> dict[str, float]:
    """Run some code in a fresh interpreter; the numbers it prints."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def memory_table() -> None:
    """Peak memory of ten million samples."""
    heading("Memory of a run of 10,000,000 samples")
    found = in_process(MEMORY)
    peak, arrays = found["peak"] / 2**20, found["arrays"] / 2**20
    print(
        f"peak rise {peak:.0f} MiB, arrays returned {arrays:.0f} MiB ({peak / arrays:.2f} times), "
        f"{found['switches']:.0f} switches"
    )


def compile_table() -> None:
    """First calls with an empty compile cache, and from it."""
    heading("First calls, seconds of processor time")
    with tempfile.TemporaryDirectory() as cache:
        first = in_process(COMPILE, NUMBA_CACHE_DIR=cache)
        later = in_process(COMPILE, NUMBA_CACHE_DIR=cache)
    print(f"{'':20s} {'compiling':>10s} {'from cache':>10s}")
    for name in first:
        print(f"{name:20s} {first[name]:10.2f} {later[name]:10.2f}")
    print(f"{'in all':20s} {sum(first.values()):10.2f} {sum(later.values()):10.2f}")


def main() -> None:
    """Print every table, or those asked for."""
    tables = {
        "samples": samples_table,
        "effects": effects_table,
        "structures": structures_table,
        "stickslip": lambda repeat: stick_slip_table(repeat, chosen.plot),
        "servo": servo_table,
        "memory": lambda repeat: memory_table(),
        "compile": lambda repeat: compile_table(),
    }
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", nargs="*", metavar="TABLE", help=f"of {', '.join(tables)}")
    parser.add_argument("--repeat", type=int, default=7, help="repetitions of each timing")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="picture of table stickslip")
    chosen = parser.parse_args()
    if unknown := set(chosen.tables) - set(tables):
        parser.error(f"no table {', '.join(sorted(unknown))}; there are {', '.join(tables)}")
    for name in chosen.tables or tables:
        tables[name](chosen.repeat)


if __name__ == "__main__":
    main()
