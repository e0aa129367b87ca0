"""FMUs against the simulation: by FMPy, step by step, in a closed loop."""

import dataclasses
import shutil

import native
import numpy as np
import pytest
from each_effect import BY_SLUG, EFFECTS
from remembering import SLIP, WARM

import dryfric_control as dfc
from dryfric_control.export import export_fmu

fmpy = pytest.importorskip("fmpy", reason="no fmpy: FMUs are neither built nor run")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(native.GCC is None, reason="no gcc: FMUs are not built")

E = dfc.effects
DT, VERSIONS = 1e-3, ("3.0", "2.0")
STAGE = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 2e-3),
    effects=(E.BiasForce(1.0), E.Cogging(0.5, 0.01), E.DwellTime(0.5, 1.0)), name="stage",
)  # fmt: skip
N = 1500
U = native.random_drive(np.random.default_rng(5), N)


class Unit:
    """One FMU at work, whatever its version; variables by name."""

    def __init__(self, path, folder, values=()):
        self.description = fmpy.read_model_description(str(path))
        unzipped = fmpy.extract(str(path), unzipdir=str(folder))
        kind = FMU3Slave if self.description.fmiVersion.startswith("3") else FMU2Slave
        self.three = kind is FMU3Slave
        name = self.description.coSimulation.modelIdentifier
        self.fmu = kind(
            guid=self.description.guid, unzipDirectory=unzipped, modelIdentifier=name,
            instanceName=name,
        )  # fmt: skip
        variables = self.description.modelVariables
        self.references = {v.name: v.valueReference for v in variables}
        self.whole = {v.name for v in variables if v.type in ("Int32", "Integer")}
        self.fmu.instantiate()
        self.values = dict(values)
        self.begin()

    def begin(self):
        if not self.three:
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.set(**self.values)
        self.fmu.exitInitializationMode()

    def set(self, **values):
        write = self.fmu.setFloat64 if self.three else self.fmu.setReal
        for name, value in values.items():
            write([self.references[name]], [value])

    def get(self, name):
        if name in self.whole:
            read = self.fmu.getInt32 if self.three else self.fmu.getInteger
        else:
            read = self.fmu.getFloat64 if self.three else self.fmu.getReal
        return read([self.references[name]])[0]

    def step(self, t, h=DT):
        self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h)

    def state(self, what, *given):
        """Get, set, serialize or deserialize it: FMPy names this otherwise for each version."""
        name = f"{what}FMUState" if self.three else f"{what}FMUstate"
        return getattr(self.fmu, name.replace("deserializeFMUs", "deSerializeFMUs"))(*given)


def run(unit, u, h=DT, names=("x", "v", "friction", "mode")):
    """Rows of a plant under a held input, each under the input of its sample."""
    rows = []
    for k, force in enumerate(u):
        unit.set(u=force)
        rows.append([unit.get(name) for name in names])
        unit.step(k * h, h)
    return np.array(rows).T


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    """The plant in both versions."""
    folder = tmp_path_factory.mktemp("stage")
    return {v: export_fmu(STAGE, folder / f"stage{v[0]}.fmu", v) for v in VERSIONS}


@pytest.mark.parametrize("version", VERSIONS)
def test_the_plant_is_valid_and_agrees_with_simulate(stages, tmp_path, version):
    assert validate_fmu(str(stages[version])) == []
    expected = STAGE.simulate(U, DT)
    assert set(expected.mode) == {-1, 0, 1}
    rows = run(Unit(stages[version], tmp_path), U)
    assert np.abs(rows - expected.y).max() < 1e-9


def test_step_sizes_each_after_a_reset(stages, tmp_path):
    unit = Unit(stages["3.0"], tmp_path)
    for h in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2):
        u = U[:200]
        rows = run(unit, u, h, ("x", "v"))
        fine = max(1, round(h / DT))
        expected = STAGE.simulate(np.repeat(u, fine), h / fine).y[:2, ::fine]
        assert np.ptp(expected[0]) > 1e-6
        assert np.abs(rows - expected).max() < 1e-9
        unit.fmu.reset()
        unit.begin()
        assert unit.get("x") == 0.0


@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_kept_stored_and_put_back(stages, tmp_path, version):
    unit = Unit(stages[version], tmp_path, {"x0": 0.1, "v0": 0.2})
    assert (unit.get("x"), unit.get("v")) == (0.1, 0.2)
    run(unit, U[:300])
    kept = unit.state("get")
    stored = unit.state("serialize", kept)
    first = run(unit, U[300:600])
    unit.state("set", kept)
    assert np.array_equal(run(unit, U[300:600]), first)
    other = Unit(stages[version], tmp_path / "other")
    other.state("set", other.state("deserialize", stored))
    assert np.array_equal(run(other, U[300:600]), first)


#: What the code is written for, and an FMU cannot change.
BUILT_IN = {
    "input_delay": {"delay"}, "actuator_lag": {"time_constant"}, "presliding": {"bristles"},
    "backlash": {"load_fraction", "friction_on_motor", "compliance", "damping"},
    "load_encoder_backlash": {"load_fraction", "friction_on_motor"},
    "compliance": {"load_fraction", "friction_on_motor"}, "load_dependence": {"of_drive"},
    "load_asymmetry": {"of_drive"}, "position_force": {"middle", "reach"},
}  # fmt: skip


#: A play whose ends give way, and what is a parameter of it.
TEETH = dfc.effects.Backlash(1e-4, 0.4, 0.0, 1e-5, 10.0)
USED = {TEETH: {"compliance", "damping"}}
#: Apart from the others, as an axis has one transmission and the period of one effect alone is
#: offered: the shortest of several is built in.
APART = (
    "presliding compliance cogging, backlash eccentric_encoder position_force, "
    "load_encoder_backlash gravity, friction_ripple"
)
GROUPS = [tuple(BY_SLUG[slug] for slug in group.split()) for group in APART.split(",")]
GROUPS.append((TEETH,))
GROUPS.append(tuple(e for e in EFFECTS if all(e not in group for group in GROUPS)))
GROUPS.append((SLIP, WARM))


@pytest.mark.parametrize("effects", GROUPS, ids=lambda effects: effects[0].slug)
def test_every_effect_acts_as_in_simulate(tmp_path, effects):
    u, start = np.append(np.zeros(100), np.linspace(0.0, 30.0, 200)), {"x0": 0.02, "v0": -0.03}
    axis = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=4.0, effects=effects, name="stage")
    expected = axis.simulate(u, DT, **start)
    assert np.ptp(expected.y[0]) > 1e-4
    out, _ = native.Native(axis, tmp_path, dt=DT).run(u, starts=[0.02, -0.03])
    assert native.ulps(out, expected.y) == 0
    unit = Unit(export_fmu(axis, tmp_path / "stage.fmu", dt=DT), tmp_path / "unit", start)
    assert np.abs(run(unit, u) - expected.y).max() < 1e-9
    # Their parameters act, each that is offered.
    for effect in effects:
        offered = {p for p in type(effect).parameters() if f"{effect.slug}_{p}" in unit.references}
        if effect.action != "axis":
            built_in = BUILT_IN.get(effect.slug, set()) - USED.get(effect, set())
            assert offered == set(type(effect).parameters()) - built_in
        for name in offered:
            moved = dataclasses.replace(effect, **{name: 1.3 * getattr(effect, name)})
            unit.fmu.reset()
            unit.values = start | {f"{effect.slug}_{name}": getattr(moved, name)}
            unit.begin()
            changed = tuple(moved if e is effect else e for e in effects)
            other = axis.replace(effects=changed).simulate(u, DT, **start).y
            assert not np.array_equal(other, expected.y), f"{effect.slug}.{name}"
            assert np.abs(run(unit, u) - other).max() < 1e-9


def test_what_is_out_of_range_is_refused(stages, tmp_path):
    unit = Unit(stages["3.0"], tmp_path)
    for wrong in ({"mass": 0.0}, {"viscous": -1.0}, {"u": np.nan}):
        with pytest.raises(FMICallException):
            unit.set(**wrong)
    with pytest.raises(FMICallException):
        unit.step(0.0, -1e-3)


def test_the_closed_loop_of_fmus_is_the_simulated_one(stages, tmp_path):
    comp = dfc.design_compensation(STAGE, dt=DT, encoder_quantum=1e-6)
    design = comp.observer
    files = [export_fmu(comp, tmp_path / "comp.fmu"), export_fmu(design, tmp_path / "obs.fmu")]
    assert [validate_fmu(str(file)) for file in files] == [[], []]
    move = dfc.motion_profile(
        [0.0, 0.01, 0.0], DT, velocity=0.05, acceleration=1.0, jerk=50.0, dwell=0.05
    )
    expected = dfc.simulate_loop(STAGE, comp.controller, move, quantum=1e-6)
    plant, control, watch = (
        Unit(path, tmp_path / str(i)) for i, path in enumerate([stages["3.0"], *files])
    )
    samples, rows = move.rows.T, []
    for k in range(len(samples)):
        y = 1e-6 * np.floor(plant.get("x") / 1e-6 + 0.5)
        xref, vref, aref = samples[min(k + comp.lead, len(samples) - 1)]
        control.set(xref=xref, vref=vref, aref=aref, y=y)
        control.step(k * DT)
        u = control.get("u")
        watch.set(u=u, y=y)
        watch.step(k * DT)
        plant.set(u=u)
        rows.append([plant.get("x"), plant.get("v"), u, watch.get("xhat"), watch.get("vhat")])
        plant.step(k * DT)
    x, v, u, xhat, vhat = np.array(rows).T
    assert np.abs([x, v] - expected.y[:2]).max() < 1e-9
    assert np.abs(u - expected.y[4]).max() < 1e-6
    estimate = dfc.observe(design, u, 1e-6 * np.floor(x / 1e-6 + 0.5), xhat0=0.0)
    assert np.array_equal([xhat, vhat], estimate.y[:2])


@pytest.mark.parametrize(
    ("make", "version"), [(dfc.hybrid_filter, "3.0"), (dfc.design_compensation, "2.0")]
)
def test_what_estimates_and_compensates_is_valid(tmp_path, make, version):
    made = make(STAGE, DT, encoder_quantum=1e-6)
    assert validate_fmu(str(export_fmu(made, tmp_path / "made.fmu", version))) == []


def test_no_compiler_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ValueError, match="there is no C compiler"):
        export_fmu(STAGE, tmp_path / "stage.fmu")
    assert list(tmp_path.iterdir()) == []
