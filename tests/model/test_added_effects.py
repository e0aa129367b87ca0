"""Effects of the catalogue that came later, against the independent truth."""

import dataclasses
import math

import numpy as np
import pytest
from diagnosis_cases import believed, record
from test_new_effect import registry
from truth import make_case, open_loop
from truth.plant import _read

import dryfric_control as dfc
from dryfric_control.estimation.force_residual import View
from dryfric_control.estimation.parameters import choose, typical
from dryfric_control.store.axis_file import axis_from_dict, axis_to_dict

DT = 1e-3
fx = dfc.effects
#: Effect, and others that it must not be taken for.
ADDED = {
    "warm_up": (fx.WarmUp, (fx.Drift, fx.PositionDependence)),
    "stribeck_asymmetry": (fx.StribeckAsymmetry, (fx.StribeckPeak, fx.CoulombAsymmetry)),
    "load_asymmetry": (fx.LoadAsymmetry, (fx.LoadDependence, fx.BiasForce, fx.CoulombAsymmetry)),
    "eccentric_encoder": (fx.EccentricEncoder, (fx.Cogging, fx.Compliance)),
    "load_encoder_backlash": (fx.LoadEncoderBacklash, (fx.Backlash, fx.InputDelay)),
}


def hidden(slug, seed=1, condition="short"):
    """A case of the bench and the axis that has the effect."""
    case = make_case(slug, seed, condition)
    axis = believed(case)
    effect = ADDED[slug][0](**case.truth[slug])
    return case, axis.replace(effects=(effect,))


@pytest.mark.parametrize("slug", ADDED)
def test_a_run_is_that_of_the_truth(slug):
    for seed in (1, 2):
        case, axis = hidden(slug, seed)
        n, stiffer, finer = (1500, 100.0, 20) if case.plant.gap else (3000, 1.0, 8)
        plant = case.plant._replace(
            coupling_stiffness=stiffer * case.plant.coupling_stiffness,
            coupling_damping=math.sqrt(stiffer) * case.plant.coupling_damping,
        )
        states = open_loop(plant, case.u[:n], DT, finer * case.substeps, case.states[0])[:n]
        readings = np.array([_read(plant, state) for state in states])
        run = axis.simulate(case.u[:n], DT, x0=case.states[0, 0])
        error = np.abs(run.y[0] - readings).max()
        without = axis.replace(effects=()).simulate(case.u[:n], DT, x0=case.states[0, 0])
        # The stick band shortens a stop by Sigma/p = 2e-7 m; friction that falls with speed
        # magnifies it at the next start, and an impact takes the truth some time: two
        # hundredths of a play of 1 mm.
        assert error < (2e-5 if case.plant.gap else 1e-5)
        assert np.abs(without.y[0] - readings).max() > 40.0 * error


@pytest.mark.parametrize("slug", ADDED)
def test_guessed_fitted_and_stored(slug, tmp_path):
    case, axis = hidden(slug)
    cls, measured = ADDED[slug][0], record(case)
    guesses = [guess for guess, _ in cls.guess(View(believed(case), measured))]
    assert guesses
    for guess in guesses:
        cls(**guess)
    name, value = next(iter(case.truth[slug].items()))
    off = dataclasses.replace(axis.effects[0], **{name: 0.8 * value})
    found = dfc.fit(axis.replace(effects=(off,)), measured, free=(f"{slug}.{name}",))
    assert found.parameters[f"{slug}.{name}"] == pytest.approx(value, rel=0.03)
    # A fit adds it, from nothing.
    if slug != "load_encoder_backlash":  # but for a play, which has no neutral width
        bare = choose(believed(case), (slug,), typical([measured]))[0]
        assert [effect.slug for effect in bare.effects] == [slug]
    dfc.write_axis(axis, tmp_path / "axis.toml")
    assert dfc.read_axis(tmp_path / "axis.toml") == axis
    assert axis_from_dict(axis_to_dict(axis)) == axis
    assert slug in axis.describe()


@pytest.mark.parametrize("slug", ADDED)
def test_diagnosed(slug):
    case, _ = hidden(slug)
    cls, rivals = ADDED[slug]
    with registry(cls, *rivals):
        found = dfc.diagnose(believed(case), record(case), jobs=1)
    assert [cause.effect for cause in found.causes] == [slug], str(found)
