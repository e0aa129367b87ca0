"""How fast and how exact the simulation is, beside what else could do it (2 min).

    python benchmarks/simulation.py samples     time of a sample of some axes, 3 s
    python benchmarks/simulation.py effects     what one effect adds to it, 3 s
    python benchmarks/simulation.py structures  contact and transmission, by what they do, 3 s
    python benchmarks/simulation.py stickslip   time and error of switches by law and method, 1 min;
                                                --plot FILE; with nosnoc 2 min more
    python benchmarks/simulation.py servo       the same of a sampled position loop, 10 s
    python benchmarks/simulation.py memory      peak of ten million samples, 7 s
    python benchmarks/simulation.py compile     import and first calls, compiling and from the
                                                cache, 45 s

Times are processor times, the best and the median of several repetitions taken in turns, compiled
code warmed up; nothing here uses more than one thread.  Errors are against a tight solution of the
same law, stated with each table.
"""

from __future__ import annotations

import tempfile
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from pathlib import Path

import control as ct
import numpy as np
import pictures
import simulation_peers as peers
from harness import Table, fresh_process, print_tables, race

import dryfric_control as dfc
from dryfric_control import effects as fx

DT = 1e-3
PLAIN = dfc.FrictionAxis(mass=1.0, viscous=0.4, coulomb=1.0)


def samples_table(given: Namespace) -> None:
    """Time of one 1 ms sample for a handful of axes."""
    t = np.arange(100_000) * DT
    sine = 3.0 * np.sin(2 * np.pi * 0.5 * t)
    shaped = PLAIN.replace(
        coulomb=dfc.CoulombMap(plus=[1.0, 0.05, 0.02, -0.01], minus=[1.1, -0.04, 0.01, 0.01]),
        travel=(-1.0, 1.0),
        stribeck=dfc.Stribeck(excess=0.3, speed=0.01),
    )
    three = (fx.Spring(stiffness=2.0), fx.Cogging(amplitude=0.1, period=0.01), fx.BiasForce(0.1))
    rows = {
        "constant Coulomb level": partial(PLAIN.simulate, sine, DT),
        "cubic maps, Stribeck peak": partial(shaped.simulate, sine, DT),
        "the same, 3 effects": partial(shaped.replace(effects=three).simulate, sine, DT),
        "at rest": partial(PLAIN.simulate, 0.2 * sine, DT),
        "stick-slip on a spring": partial(
            pulled_axis(peers.StickSlip()).simulate, 0.2 * t, DT, hold="first"
        ),
    }
    table = Table(
        {"axis": "30s", "ns min": "9.1f", "median": "9.1f", "switches": "10d", "sliding": "9.0%"},
        "One 1 ms sample of FrictionAxis.simulate, 100,000 samples",
    )
    found = race(list(rows.values()), given.repeat)
    for name, (best, median, run) in zip(rows, found, strict=True):
        ns = 1e9 / t.size
        table.row(name, ns * best, ns * median, len(run.events), np.mean(run.mode != 0))


def effects_table(given: Namespace) -> None:
    """Time that one effect adds to a sample while sliding."""
    u = np.full(100_000, 1.5)
    effects = [
        fx.BiasForce(force=0.01),
        fx.ViscousAsymmetry(viscous=0.01),
        fx.CoulombAsymmetry(force=0.01),
        fx.QuadraticDrag(drag=0.01),
        fx.Spring(stiffness=1e-3),
        fx.Gravity(amplitude=0.01),
        fx.Cogging(amplitude=0.01, period=1.0),
        fx.InputDelay(delay=2.3e-3),
        fx.InputGain(gain=0.99),
        fx.DeadZone(width=0.01),
    ]
    axes = [PLAIN, *(PLAIN.replace(effects=(effect,)) for effect in effects)]
    found = race([partial(axis.simulate, u, DT, v0=0.1) for axis in axes], 3 * given.repeat)
    alone = found[0][0]
    table = Table(
        {"effect": "20s", "ns": "+8.1f"},
        f"Cost of one effect, sliding all the time; without effects {1e9 * alone / u.size:.1f} ns",
    )
    for effect, (best, _, run) in zip(effects, found[1:], strict=True):
        assert np.all(run.mode == 1)
        table.row(effect.slug, 1e9 * (best - alone) / u.size)


def structures_table(given: Namespace) -> None:
    """Time of a sample with a contact or a transmission, by what the axis does."""
    n = 100_000
    t = np.arange(n) * DT
    base = dfc.FrictionAxis(mass=2.0, viscous=6.0, coulomb=8.0)
    structures = {
        "rigid": (),
        "presliding": (fx.Presliding(distance=40e-6),),
        "backlash": (fx.Backlash(gap=2e-4, load_fraction=0.4),),
        "compliance": (fx.Compliance(stiffness=3e4, damping=12.0, load_fraction=0.4),),
    }
    duties = {
        "sliding": np.full(n, 12.0),
        "holding": np.full(n, 4.0),
        "to and fro": 20.0 * np.sin(2 * np.pi * t),
    }
    axes = [base.replace(effects=effects) for effects in structures.values()]
    works = [partial(axis.simulate, u, DT) for axis in axes for u in duties.values()]
    # A play as wide as the way: the motor rocks between its ends and never arrives.
    wide = base.replace(effects=(fx.Backlash(gap=10.0, load_fraction=0.4),))
    works.append(partial(wide.simulate, np.where(t % 0.4 < 0.2, 1.0, -1.0), DT))
    found = [best / n * 1e9 for best, _, _ in race(works, given.repeat)]
    table = Table({"ns a 1 ms sample": "17s"} | dict.fromkeys(duties, "12.1f"))
    for i, name in enumerate(structures):
        table.row(name, *found[3 * i : 3 * i + 3])
    print(f"in the play, without contact: {found[-1]:.1f}")


# --- the free stick-slip run ----------------------------------------------------------


def axis_of(problem: peers.StickSlip | peers.Servo, **more) -> dfc.FrictionAxis:  # type: ignore[no-untyped-def]
    """The axis of a problem."""
    return dfc.FrictionAxis(
        mass=problem.mass,
        viscous=problem.viscous,
        coulomb=problem.coulomb,
        stribeck=dfc.Stribeck(excess=problem.excess, speed=problem.stribeck_speed),
        stick_speed=problem.stick_speed,
        stick_rate=problem.stick_rate,
        **more,
    )


def pulled_axis(problem: peers.StickSlip) -> dfc.FrictionAxis:
    """The axis of the stick-slip problem, on its spring."""
    return axis_of(problem, effects=(fx.Spring(stiffness=problem.stiffness),))


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


#: Laws of the stick-slip run: what each is called in a legend.
LAWS = {
    "switched": "switched model",
    "lugre": "LuGre",
    "tanh": "tanh",
    "linear": "regularised (Modelica style)",
    "slips": "against the switched model",
}
Case = tuple[str, str, Callable[[], peers.Breaks]]


def switched_cases(p: peers.StickSlip) -> list[Case]:
    """Name, law and run of the ways to solve the switched model."""
    runs = {f"ours, {1e3 * dt:g} ms samples": partial(pulled, p, dt) for dt in (1e-3, 1e-2, 0.1)}
    for rtol in (1e-6, 1e-8, 1e-10):
        name = f"events, DOP853 compiled {rtol:.0e}"
        runs[name] = partial(peers.events_dop853, p, rtol)
    for method, rtol in (("RK45", 1e-6), ("RK45", 1e-10), ("DOP853", 1e-8), ("LSODA", 1e-10)):
        name = f"events, solve_ivp {method} {rtol:.0e}"
        runs[name] = partial(peers.events_solve_ivp, p, method, rtol)
    for name, step in (("1 ms", 1e-3), ("10 µs", 1e-5)):
        runs[f"compiled Euler, {name}"] = partial(peers.euler_loop, p, step)
    return [(name, "switched", run) for name, run in runs.items()]


def smooth_cases(p: peers.StickSlip) -> list[Case]:
    """The same of LuGre and tanh."""
    rates = {"lugre": peers.lugre_rates(p), "tanh": peers.tanh_rates(p)}
    our = {
        "lugre": dfc.laws.LuGre(stiffness=1e5, damping=300.0),
        "tanh": dfc.laws.Tanh(speed=1e-5),
    }
    cases: list[Case] = []
    for law, title in (("lugre", "LuGre"), ("tanh", "tanh")):
        own = rates[law]
        runs = {f"ours, {title} 1e-8, 1 ms": partial(pulled, p, DT, our[law])}
        for method, rtol in (("LSODA", 1e-6), ("LSODA", 1e-8), ("LSODA", 1e-10), ("Radau", 1e-6)):
            name = f"{title}, {method} {rtol:.0e}"
            runs[name] = partial(peers.smooth_solve_ivp, p, own, method, rtol)
        runs[f"{title}, odeint 1e-8"] = partial(peers.smooth_odeint, p, own, 1e-8)
        if law == "lugre":
            for name, method, rtol in (("LSODA 1e-6", "LSODA", 1e-6), ("defaults", "RK45", 1e-3)):
                name = f"{title}, python-control {name}"
                runs[name] = partial(peers.control_response, p, own, method, rtol)
        cases += [(name, law, run) for name, run in runs.items()]
    return cases


def installed_cases(p: peers.StickSlip, folder: Path) -> list[Case]:
    """Those of software that may not be installed."""
    cases: list[Case] = []
    if peers.fmpy and peers.gcc:
        fmu = peers.regularised_fmu(p, folder)
        cases += [
            (f"linear, FMU by CVode {rtol:.0e}", "linear", partial(peers.fmu_cvode, p, fmu, rtol))
            for rtol in (1e-6, 1e-8, 1e-10)
        ]
    else:
        print("fmpy or gcc is not installed: the rows of the FMU are left out")
    if peers.nosnoc:
        cases.append(("nosnoc, FESD, 20 ms", "slips", partial(peers.fesd, p)))
    else:
        print("nosnoc is not installed: its row is left out")
    if peers.mujoco:
        default = "0.9 0.95 0.001 0.5 2"
        runs = {
            "its defaults, 1 ms": partial(peers.mujoco_slide, p, 1e-3, solimp=default),
            "stiff solimp, 1 ms": partial(peers.mujoco_slide, p, 1e-3),
            "stiff solimp, 0.1 ms": partial(peers.mujoco_slide, p, 1e-4),
        }
        cases += [(f"MuJoCo, {name}", "slips", run) for name, run in runs.items()]
    else:
        print("MuJoCo is not installed: its rows are left out")
    return cases


def stick_slip_table(given: Namespace) -> None:
    """40 s of stick-slip: time against accuracy of the transitions."""
    p = peers.StickSlip()
    print(
        "\n40 s of stick-slip, five breakaways\n"
        "error: largest error of the five transition times against the same law's own tight\n"
        "solution (switched: instants of breakaway, DOP853 1e-13; LuGre, tanh, linear: velocity\n"
        "rising through 10 mm/s, Radau 1e-11; nosnoc, MuJoCo: the same, of the switched model).\n"
        "limit: the same against the switched model. inf: not five."
    )
    exact = peers.events_dop853(p, 1e-13)
    truth = {"switched": exact.modes, "slips": exact.slips}
    for law in ("lugre", "tanh", "linear"):
        rates = getattr(peers, f"{law}_rates")(p)
        truth[law] = peers.smooth_solve_ivp(p, rates, "Radau", 1e-11).slips
    with tempfile.TemporaryDirectory() as folder:
        cases = switched_cases(p) + smooth_cases(p) + installed_cases(p, Path(folder))
        raced = race([work for _, _, work in cases], given.repeat)
    ours = raced[0][0]
    table = Table(
        {"": "34s", "ms min": "10.2f", "median": "10.2f", "error s": "10.1e", "limit s": "10.1e",
         "x ours": "9.2f"}
    )  # fmt: skip
    done = []
    for (name, law, _), (best, median, found) in zip(cases, raced, strict=True):
        error = worst(found.modes if law == "switched" else found.slips, truth[law])
        limit = error if law == "switched" else worst(found.slips, truth["slips"])
        done.append((name, law, best, error))
        table.row(name, 1e3 * best, 1e3 * median, error, limit, best / ours)
    rivals = [row for row in done if row[1] == "switched" and "ours" not in row[0]]
    print_fastest("peer", [row for row in rivals if row[3] <= done[0][3]], ours)
    if given.plot:
        pictures.work_precision(done, LAWS, given.plot)
    sampled_block_row(p, ours)


def print_fastest(kind: str, rows: list[tuple[str, str, float, float]], ours: float) -> None:
    """The fastest of the rows that are exact enough."""
    if rows:
        name, _, best, _ = min(rows, key=lambda row: row[2])
        print(f"fastest {kind} at least as exact as ours: {name}, {best / ours:.1f} x our time")


def sampled_block_row(problem: peers.StickSlip, ours: float) -> None:
    """python-control's response of our sampled block, against the compiled run."""
    axis = pulled_axis(problem)
    t = np.arange(round(problem.duration / DT) + 1) * DT
    u = problem.stiffness * problem.belt * t
    block = dfc.axis_block(axis, dt=DT)
    begin = time.process_time()
    found = ct.input_output_response(block, t, u)
    spent = time.process_time() - begin
    gap = np.abs(found.outputs[:2] - axis.simulate(u, DT).y[:2]).max()
    print(
        f"python-control's response of axis_block, held input: {spent * 1e3:.0f} ms, "
        f"{spent / ours:.0f} x our time, within {gap:.1e} of simulate()"
    )


# --- the sampled servo loop -----------------------------------------------------------


def servo_table(given: Namespace) -> None:
    """A 1 ms position loop on an encoder, switching inside samples."""
    p = peers.Servo()
    exact, modes = peers.servo_solve_ivp(p, "DOP853", 1e-12, 2.5e-4)
    axis, reference = axis_of(p), p.reference
    loop = dfc.PositionController(kp=p.kp, ki=0.0, kd=p.kd, dt=p.dt)

    def compiled() -> tuple[np.ndarray, None]:
        return dfc.simulate_loop(axis, loop, reference, quantum=p.quantum).y[0], None

    def stepped() -> tuple[np.ndarray, None]:
        plant = axis.stepper(p.dt)
        x = np.empty(reference.size)
        last = 0.0
        for k, r in enumerate(reference.tolist()):
            x[k] = plant.x
            y = p.quantum * np.floor(plant.x / p.quantum + 0.5)
            plant.step(p.kp * (r - y) - p.kd * (y - last) / p.dt)
            last = y
        return x, None

    cases: dict[str, Callable[[], tuple[np.ndarray, np.ndarray | None]]] = {
        "ours, simulate_loop": compiled,
        "ours, stepper() in a Python loop": stepped,
        "solve_ivp RK45 1e-8": partial(peers.servo_solve_ivp, p, "RK45", 1e-8),
        "DOP853 compiled 1e-8": partial(peers.servo_dop853, p, 1e-8),
    }
    for count in (1, 2, 4):
        cases[f"hand-written RK4, substeps: {count}"] = partial(peers.servo_rk4, p, count)
    if peers.mujoco:
        cases["MuJoCo, stiff solimp"] = partial(peers.servo_mujoco, p)
    else:
        print("MuJoCo is not installed: its rows are left out")
    table = Table(
        {"": "34s", "us/sample": "10.3f", "median": "10.3f", "error m": "10.1e", "x ours": "9.1f"},
        f"1 ms servo loop, PD controller, encoder, held input: {modes.size} samples, "
        f"{np.count_nonzero(np.diff(modes))} switches; error: largest of x\n"
        "at the samples against solve_ivp DOP853 1e-12",
    )
    raced = race(list(cases.values()), given.repeat)
    ours, done = raced[0][0], []
    for name, (best, median, (x, _)) in zip(cases, raced, strict=True):
        error = float(np.abs(x - exact).max())
        kind = "hand-written loop" if name.startswith("hand-written") else "library"
        done.append((name, "ours" if "ours" in name else kind, best, error))
        table.row(name, best / x.size * 1e6, median / x.size * 1e6, error, best / ours)
    for kind in ("library", "hand-written loop"):
        rivals = [row for row in done if row[1] == kind and row[3] <= done[0][3]]
        print_fastest(kind, rivals, ours)


# --- memory and compilation, each in a process of its own -----------------------------

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
def load_control():
    import control
def load():
    global dfc, np
    import numpy as np
    import dryfric_control as dfc
lap("import of control", load_control)
lap("import beyond it", load)
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


def memory_table(given: Namespace) -> None:
    """Peak memory of ten million samples."""
    found = fresh_process("-c", MEMORY)
    peak, arrays = found["peak"] / 2**20, found["arrays"] / 2**20
    print(
        f"\nA run of 10,000,000 samples: peak rise {peak:.0f} MiB, arrays returned {arrays:.0f} "
        f"MiB ({peak / arrays:.2f} times), {found['switches']:.0f} switches"
    )


def compile_table(given: Namespace) -> None:
    """First calls with an empty compile cache, and from it."""
    with tempfile.TemporaryDirectory() as cache:
        first, later = (fresh_process("-c", COMPILE, NUMBA_CACHE_DIR=cache) for _ in range(2))
    table = Table(
        {"first calls [s]": "20s", "compiling": "11.2f", "from cache": "11.2f"},
    )
    for name in first:
        table.row(name, first[name], later[name])
    table.row("in all", sum(first.values()), sum(later.values()))


if __name__ == "__main__":
    print_tables(
        __doc__,
        {
            "samples": samples_table,
            "effects": effects_table,
            "structures": structures_table,
            "stickslip": stick_slip_table,
            "servo": servo_table,
            "memory": memory_table,
            "compile": compile_table,
        },
        {
            "--repeat": (7, "repetitions of each timing"),
            "--plot": (Path, "picture of table stickslip"),
        },
    )
