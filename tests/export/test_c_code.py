"""Exported C against the kernels it is translated from."""

import math
import re
import subprocess
from dataclasses import dataclass

import native
import numpy as np
import pytest
from remembering import BOND, SLIP, WARM

import dryfric_control as dfc
from dryfric_control.export import export_c
from dryfric_control.store.saved import read_document

E = dfc.effects
AXIS = dfc.FrictionAxis(
    mass=2.0, viscous=15.0, coulomb=8.0, stribeck=dfc.Stribeck(0.3, 2e-3),
    effects=(E.BiasForce(1.0), E.Cogging(0.5, 0.01), E.DeadZone(0.1), E.DwellTime(0.5, 1.0)),
    name="stage",
)  # fmt: skip
LATE = AXIS.replace(effects=(*AXIS.effects, E.InputDelay(2.3e-3), E.ActuatorLag(1e-3)))
N = 4000
U = native.random_drive(np.random.default_rng(7), N)
Y = native.reading(native.mismatched(LATE, np.random.default_rng(8)), U)
needs_gcc = pytest.mark.skipif(native.GCC is None, reason="no gcc: exported C is not compiled")


def same(code, inputs, expected):
    """Whether C and kernel return the same bits."""
    out, switches = code.run(*inputs)
    assert native.ulps(out, expected) == 0
    assert np.ptp(expected[0]) > 0.0
    return switches


@needs_gcc
@pytest.mark.parametrize("seed", [0, 1])
def test_axes_are_the_same_bit_for_bit(tmp_path, seed):
    axis = native.random_axis(np.random.default_rng(seed))
    expected = axis.simulate(U, 1e-3)
    switches = same(native.Native(axis, tmp_path), (U,), expected.y)
    assert np.array_equal(switches[: len(expected.events.time), 0], expected.events.time)


@needs_gcc
@pytest.mark.parametrize("kind", range(len(native._STRUCTURES)))
def test_axes_with_inner_states_are_the_same(tmp_path, kind):
    axis = AXIS.replace(effects=native._STRUCTURES[kind](np.random.default_rng(3)))
    same(native.Native(axis, tmp_path), (U,), axis.simulate(U, 1e-3).y)


@needs_gcc
@pytest.mark.parametrize("effects", [(SLIP,), (SLIP, WARM), (BOND,)], ids=lambda e: e[-1].slug)
@pytest.mark.parametrize("coulomb", [8.0, 0.0])
def test_axes_whose_effects_have_states_are_the_same(tmp_path, effects, coulomb):
    axis = LATE.replace(coulomb=coulomb, effects=(*LATE.effects, *effects))
    expected = axis.simulate(U, 1e-3)
    switches = same(native.Native(axis, tmp_path), (U,), expected.y)
    assert np.array_equal(switches[: len(expected.events.time), 0], expected.events.time)


def observed(axis, form="current"):
    return dfc.design_pi_observer(axis, dt=1e-3, encoder_quantum=1e-6, form=form)


@needs_gcc
@pytest.mark.parametrize(
    "made",
    [
        observed(LATE),
        observed(LATE, "prediction"),
        dfc.hybrid_filter(LATE, 1e-3, 1e-6),
        dfc.extended_state_observer(LATE, 1e-3, 1e-6, feedforward=True),
    ],
    ids=["current", "prediction", "filter", "extended state"],
)
def test_observers_are_the_same(tmp_path, made):
    same(native.Native(made, tmp_path), (U, Y), native.by_kernel(made, U, Y))


def compensated(law="learned"):
    return dfc.design_compensation(AXIS, dt=1e-3, encoder_quantum=1e-6, law=law)


@needs_gcc
@pytest.mark.parametrize("law", ["learned", "disturbance observer", "adrc"])
def test_the_compensation_is_the_same(tmp_path, law):
    rows = dfc.motion_profile(
        [0.0, 0.02, -0.01, 0.02, -0.01] * 3, 1e-3, velocity=0.08, acceleration=1.0, jerk=50.0,
        dwell=0.1,
    ).rows[:, :N]  # fmt: skip
    y = rows[0] + 1e-6 * np.round(np.random.default_rng(2).normal(0.0, 5.0, rows.shape[1]))
    comp = compensated(law)
    same(native.Native(comp, tmp_path), (*rows, y), native.by_kernel(comp, *rows, y))


@pytest.mark.slow
@needs_gcc
def test_sanitizers_find_nothing(tmp_path):
    flags = ["-fsanitize=address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all"]
    made = dfc.hybrid_filter(LATE, 1e-3, 1e-6)
    out = native.Native(made, tmp_path / "filter").run_alone(U, Y, flags=flags)
    assert native.ulps(out, native.by_kernel(made, U, Y)) == 0
    axis = LATE.replace(effects=(*LATE.effects, *native._STRUCTURES[4](np.random.default_rng(0))))
    out = native.Native(axis, tmp_path / "axis").run_alone(U[:1000], flags=flags[:1])
    assert native.ulps(out[:, :-1], axis.simulate(U[:1000], 1e-3).y[:, :-1]) == 0


@needs_gcc
def test_next_returns_the_end_of_the_sample(tmp_path):
    axis = AXIS.replace(effects=(E.LoadEncoderBacklash(1e-4, 0.4), E.EccentricEncoder(1e-4, 0.01)))
    code = native.Native(axis, tmp_path)
    main = tmp_path / "driver.c"
    main.write_text(main.read_text().replace("stage_step(", "stage_next("))
    stepper, expected = axis.stepper(1e-3), []
    for u in U[:300]:
        stepper.step(u)
        expected.append([stepper.x, stepper.v, stepper.F, stepper.mode])
    assert native.ulps(code.run(U[:300])[0], np.array(expected).T) == 0


@needs_gcc
def test_an_input_that_is_no_number_changes_nothing(tmp_path):
    code = native.Native(dfc.hybrid_filter(AXIS, 1e-3, 1e-6), tmp_path)
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match="refused"):
            code.run(np.array([1.0, bad]), np.array([0.0, 0.0]))


def calls(source):
    """Functions of a C text, with those that each calls."""
    parts = re.split(r"^(?:static )?\w[\w ]*\*?\b(\w+)\([^;{]*\)\n\{$", source, flags=re.MULTILINE)
    bodies = dict(zip(parts[1::2], parts[2::2], strict=True))
    return {
        name: {n for n in bodies if re.search(rf"\b{n}\(", body)} for name, body in bodies.items()
    }


@needs_gcc
def test_no_heap_no_globals_no_recursion_and_bounded_loops(tmp_path):
    axis = LATE.replace(effects=(*LATE.effects, *native._STRUCTURES[4](np.random.default_rng(0))))
    for obj in (axis, observed(LATE), compensated()):
        source = export_c(obj, tmp_path)[1]
        text = re.sub(r"/\*.*?\*/", "", source.read_text(), flags=re.DOTALL)
        made = str(tmp_path / "x.o")
        subprocess.run(["gcc", *native.FLAGS, "-c", str(source), "-o", made], check=True)
        sizes = subprocess.run(["size", made], capture_output=True, text=True).stdout
        assert sizes.split()[7:9] == ["0", "0"]  # data and bss: no variable outlives a call
        assert not re.search(r"\b(malloc|calloc|realloc|free|alloca|while|goto)\b", text)
        graph = calls(text)
        assert len(graph) > 10
        order = {name: i for i, name in enumerate(graph)}
        assert all(order[callee] < order[name] for name in graph for callee in graph[name])


@dataclass(frozen=True)
class Magnet(E.Effect):
    """An effect of one's own, whose law has its C from its Python source."""

    strength: float = E.parameter("N m^2", "pull times distance squared")
    slug = "magnet_of_the_export_test"
    action = "force"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        gap = max(0.6 - x, 0.01)
        pull = 0.0
        for _ in range(3):
            pull += p[0] / gap**2
            gap *= 2.0
        return pull if pull < 3.0 else 3.0


@dataclass(frozen=True)
class Gamma(Magnet):
    """An effect whose law numba knows and C does not."""

    slug = "gamma_of_the_export_test"

    @staticmethod
    def law(t, x, v, u, level, direction, rest, p):
        return math.lgamma(p[0])


@needs_gcc
def test_a_law_of_ones_own_is_translated(tmp_path):
    axis = AXIS.replace(effects=(Magnet(0.05),))
    same(native.Native(axis, tmp_path), (U,), axis.simulate(U, 1e-3).y)


def test_a_law_without_c_is_refused(tmp_path):
    with pytest.raises(ValueError, match="has no C: Gamma.law, line 3 of it"):
        export_c(AXIS.replace(effects=(Gamma(0.05),)), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_names_and_folders_that_are_not_as_they_should_be(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match="cannot be made"):
        export_c(AXIS, tmp_path / "file" / "new")
    (tmp_path / "stage.c").mkdir()  # the source cannot take its place
    with pytest.raises(ValueError, match="stage.c.* is a folder"):
        export_c(AXIS, tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "stage.c"]
    # A name for people becomes one for C.
    files = export_c(AXIS.replace(name="belt stage (left)"), tmp_path)
    assert files[0].name == "belt_stage_left_.h"
    assert "belt_stage_left__step(" in files[0].read_text("utf-8")
    with pytest.raises(ValueError, match="was made for dt = 0.001 s"):
        export_c(dfc.hybrid_filter(AXIS, 1e-3, 1e-6), tmp_path, dt=2e-3)


def test_header_readme_and_numbers_say_what_there_is(tmp_path):
    header, _, numbers, readme = export_c(observed(LATE), tmp_path)
    text = header.read_text()
    assert "u [N]: drive force" in text and "decay" in text and "mode -1, 0 or 1" in text
    data, intact = read_document(numbers, "export")
    assert intact and data["dt"] == 1e-3
    assert max(data["tables"]["axis_integers"]["values"]) < 100  # counts, and no address
    assert data["operations"]["multiply"] > 10
    assert f"| multiplications | {data['operations']['multiply']} |" in readme.read_text()
