"""A whole arm: friction of its joints, errors of its model, by `arm_records` and `diagnose_arm`.

python benchmarks/arm.py [right|wrong|pinocchio|sysid|diagnose] [--seeds 10] [--seconds 20]

right      model without errors: friction of each joint by `fit`, over the truth
wrong      link masses 10 % off and a payload the model does not know; one joint with a play
pinocchio  the same as `right`, the log made by Pinocchio with friction by our own steps
sysid      beside `mujoco.sysid`: parameters, a replayed log, seconds of a core
diagnose   `diagnose_arm` on the log of `wrong`: what is named, and percent off in Coulomb level and
           friction RMS
"""

from __future__ import annotations

import argparse
import time
import warnings

import arm_truth
import mujoco
import numpy as np

import dryfric_control as dfc

# Nominal values, over the true ones: level, viscous coefficient.
_OFF = (1.3, 0.7)


def nominal(axis: dfc.FrictionAxis, own: arm_truth.Friction) -> tuple[dfc.FrictionAxis, list[str]]:
    """A joint as its user believes it to be, and what is to be fitted."""
    axis = axis.replace(coulomb=_OFF[0] * own.level, viscous=_OFF[1] * own.viscous)
    free = ["mass", "viscous", "coulomb"]
    if own.excess:
        axis, free = axis.replace(stribeck=dfc.Stribeck(0.2, 0.06)), [*free, "stribeck"]
    if own.by_load:
        axis = axis.replace(effects=(dfc.effects.LoadDependence(0.05),))
        free.append("load_dependence")
    return axis, free


def friction_error(found: dfc.FrictionAxis, own: arm_truth.Friction, v: np.ndarray) -> float:
    """RMS error of level and viscous part over the velocities of the log, relative."""

    def force(level: float, viscous: float, excess: float, speed: float) -> np.ndarray:
        return np.sign(v) * level * (1.0 + excess * np.exp(-((v / speed) ** 2))) + viscous * v

    peak = found.stribeck or dfc.Stribeck(0.0, 1.0)
    true = force(own.level, own.viscous, own.excess, own.speed)
    off = force(found.coulomb.mean, found.viscous, peak.excess, peak.speed) - true
    return float(np.sqrt(np.mean(off**2) / np.mean(true**2)))


def joints(records: dfc.arm.ArmRecords, truth: arm_truth.Truth) -> dict[str, tuple[float, ...]]:
    """Relative errors of each joint: Coulomb level, viscous coefficient, friction; seconds."""
    rows = {}
    for j, (name, (axis, record)) in enumerate(records.items()):
        own = truth.friction[j]
        axis, free = nominal(axis, own)
        start = time.process_time()
        if name == truth.play:
            axis = axis.replace(effects=(dfc.effects.Backlash(2e-3, 0.5),))
            free += ["backlash.gap", "backlash.load_fraction"]
        # A play ends in another minimum from a single start.
        starts = None if name == truth.play else 1
        found = dfc.fit(axis, record, free=free, starts=starts).axis
        seconds = time.process_time() - start
        v = records.motion.v[:, j]
        rows[name] = (
            found.coulomb.mean / own.level - 1.0, found.viscous / own.viscous - 1.0,
            friction_error(found, own, v[np.abs(v) > 0.02]), seconds,
        )  # fmt: skip
    return rows


def diagnosed(
    seed: int, model: mujoco.MjModel, log: dict[str, np.ndarray], truth: arm_truth.Truth
) -> None:
    """What `diagnose_arm` names in a log, and the friction that it leaves each joint with."""
    start = time.process_time()
    found = dfc.diagnose_arm(model, log, progress=False, jobs=1)
    print(f"seed {seed}, {time.process_time() - start:.0f} s of a core:",
          "; ".join(e.sentence for e in found.model_errors if e.named) or "nothing")  # fmt: skip
    for j, (name, one) in enumerate(found.items()):
        own, v = truth.friction[j], found.corrected.motion.v[:, j]
        off = friction_error(one.extended, own, v[np.abs(v) > 0.02])
        level = one.extended.coulomb.mean / own.level - 1.0
        causes = ", ".join(cause.effect for cause in one.causes) or "none"
        print(f"  {name:8s}{100 * level:8.2f}{100 * off:8.2f}  {one.verdict}: {causes}", flush=True)
    for name, why in found.failed.items():
        print(f"  {name}: {why}")


def shown(seed: int, rows: dict[str, tuple[float, ...]]) -> None:
    print(f"seed {seed}: percent off in Coulomb level, viscous, friction RMS; seconds")
    for name, row in rows.items():
        print(f"  {name:8s}" + "".join(f"{100 * one:8.2f}" for one in row[:3]) + f"{row[3]:8.1f}")
    print(
        f"  worst   {100 * max(row[2] for row in rows.values()):.2f} % of the friction", flush=True
    )


def wrong(seed: int, play: bool = True) -> arm_truth.Truth:
    """An arm whose model is off."""
    factors = 1.0 + 0.1 * np.random.default_rng(100 + seed).choice([-1.0, 1.0], 6)
    return arm_truth.Truth(
        mass_factors=tuple(factors.tolist()), payload=0.8, play="wrist1" if play else None
    )


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("what", choices=("right", "wrong", "pinocchio", "sysid", "diagnose"))
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--seconds", type=float, default=20.0)
    options.add_argument("--no-play", action="store_true")
    chosen = options.parse_args()
    warnings.simplefilter("ignore")
    model = mujoco.MjModel.from_xml_string(arm_truth.mjcf())
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        truth = arm_truth.Truth()
        if chosen.what in ("wrong", "diagnose"):
            truth = wrong(seed, not chosen.no_play)
        if chosen.what == "sysid":  # the friction that its model has
            plain = [one._replace(excess=0.0, by_load=0.0) for one in truth.friction]
            truth = arm_truth.Truth(friction=tuple(plain))
        if chosen.what == "pinocchio":
            import arm_pinocchio

            log = arm_pinocchio.simulate(truth, seed, chosen.seconds)
        else:
            log = arm_truth.simulate(truth, seed, chosen.seconds)
        if chosen.what == "sysid":
            import arm_sysid

            arm_sysid.compare(model, log, truth, seed)
            continue
        if chosen.what == "diagnose":
            diagnosed(seed, model, log, truth)
            continue
        start = time.process_time()
        records = dfc.arm_records(model, log)
        errors = records.model_errors()
        print(f"model, {time.process_time() - start:.1f} s:",
              "; ".join(e.sentence for e in errors if e.named) or "nothing")  # fmt: skip
        payloads = [e for e in errors if e.kind == "payload"]
        if truth.payload:
            off = payloads[0].value / truth.payload - 1.0 if payloads else -1.0
            print(f"  payload {100 * off:+.1f} % off")
        shown(seed, joints(records.without(errors) if errors else records, truth))


if __name__ == "__main__":
    main()
