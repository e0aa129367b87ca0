"""Diagnose the joints of a machine, one by one, in parallel."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from dryfric_control.arrays import Floats
from dryfric_control.checks import instance, positive
from dryfric_control.diagnosis.diagnose import (
    NOT_DIAGNOSED,
    checked_load_errors,
    diagnose,
    failure_entry,
    run_cases,
)
from dryfric_control.diagnosis.report.diagnosis import Diagnosis
from dryfric_control.diagnosis.report.findings import with_error
from dryfric_control.diagnosis.report.wording import cause_names
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.parameters import SHIFT, base_unit, checked_knowledge, values_of
from dryfric_control.estimation.plausibility import checked_records
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.records.record import Record
from dryfric_control.store.batch import fingerprint
from dryfric_control.store.saved import from_plain, to_plain
from dryfric_control.text import Result, documented, length_text, rotary_words, stated

_SAVED = (Diagnosis, *Diagnosis._holds)
#: Axis, records and errors of the known load of a joint.
_Case = tuple[FrictionAxis, tuple[Record, ...], Floats]


def base_words(axes: Iterable[FrictionAxis]) -> list[str]:
    """Names of the base parameters in the words of all axes: inertia where they turn."""
    units = {axis.units[1] for axis in axes}
    words = ({rotary_words(name, unit) for unit in units} or {name} for name in BASE)
    return [" or ".join(sorted(one, reverse=True)) for one in words]


@documented
@dataclass(frozen=True, eq=False, repr=False)
class JointDiagnoses(Result, Mapping[str, Diagnosis]):
    """Diagnoses of joints by name, with a table of what was found.

    Made by `diagnose_joints`; a mapping that `to_mjcf` and its like take as it is.  A joint that
    cannot be diagnosed is not in the mapping, but in `failed` and in the table.

    Examples
    --------
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> axis = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=1.5, units=("rad", "N m"))
    >>> t = 2e-3 * np.arange(3000)
    >>> u = 4.0 * np.sin(3.0 * t) + 2.0 * np.sin(11.0 * t)
    >>> x = 1e-5 * np.round(1e5 * axis.simulate(u, dt=2e-3).y[0])
    >>> found = dfc.diagnose_joints({"elbow": (axis, dfc.Record(t, u, x))}, progress=False)
    >>> list(found), found["elbow"].verdict
    (['elbow'], 'nothing to find')
    """

    diagnoses: dict[str, Diagnosis] = stated("The diagnosis of each joint.")
    failed: dict[str, str] = stated(
        "Joints that cannot be diagnosed, and why.", default_factory=dict
    )

    def __getitem__(self, joint: str) -> Diagnosis:
        if joint in self.failed:
            raise KeyError(f"{joint!r} is not diagnosed: {self.failed[joint]}")
        return self.diagnoses[joint]

    def __iter__(self) -> Iterator[str]:
        return iter(self.diagnoses)

    def __len__(self) -> int:
        return len(self.diagnoses)

    def parameters(self, joint: str) -> dict[str, tuple[float, float | None, str]]:
        """Value, standard error and unit of the parameters of a joint.

        Parameters
        ----------
        joint : str
            Name of the joint.

        Returns
        -------
        dict of str to tuple
            Those of `extended` that were fitted, and the base parameters; the error is None
            where the value is the nominal one, infinite where the records do not determine it.
        """
        if joint in self.failed:
            raise ValueError(f"joint {joint!r} is not diagnosed: {self.failed[joint]}")
        if joint not in self.diagnoses:
            raise ValueError(f"joint {joint!r} is not there: it has {', '.join(self.diagnoses)}")
        d = self.diagnoses[joint]
        names = [n for n in dict.fromkeys((*BASE, *d.standard_errors)) if n != SHIFT]
        axis = d.extended
        own = d.extended.named_effects()
        found = {}
        for name, value in zip(names, values_of(axis, names), strict=True):
            effect, _, part = name.partition(".")
            unit = own[effect].units(axis.units)[part] if part else axis.unit(base_unit(name))
            found[name] = (float(value), d.standard_errors.get(name), unit)
        return found

    def _summary_parts(self) -> Iterator[str | list[tuple[str, ...]]]:
        words = base_words(d.axis for d in self.values())
        head = ("joint", "verdict", "causes", "free runs", *words, "further parameters")
        rows: list[tuple[str, ...]] = [head]
        for joint, d in self.diagnoses.items():
            numbers = {n: with_error(*one) for n, one in self.parameters(joint).items()}
            further = [f"{n} {one}".rstrip() for n, one in numbers.items() if n not in BASE]
            runs = " -> ".join(length_text(v, d.gain.unit) for v in (d.gain.before, d.gain.after))
            causes = cause_names(d)
            base = (numbers[n] for n in BASE)
            rest = ", ".join(further)
            rows.append((joint, d.verdict, causes or "none", runs, *base, rest or "none"))
        rows += [(joint, NOT_DIAGNOSED, *[""] * (len(head) - 2)) for joint in self.failed]
        yield rows
        yield from (f"{joint}: {NOT_DIAGNOSED}: {why}" for joint, why in self.failed.items())
        for joint, d in self.diagnoses.items():
            yield from (f"{joint}: {message}" for message in d.messages)

    def to_dict(self) -> dict[str, Any]:
        """`to_dict` of each joint, and the reasons of those that failed."""
        found = {joint: d.to_dict() for joint, d in self.diagnoses.items()}
        reasons = self.failed.items()
        return found | {joint: {"verdict": NOT_DIAGNOSED, "reason": why} for joint, why in reasons}


def diagnose_joints(
    joints: Mapping[str, tuple[FrictionAxis, Record | Sequence[Record]]],
    *,
    known: Sequence[str] = (),
    tolerance: Mapping[str, float] | None = None,
    window: float | None = None,
    hold: str = "zero",
    time_limit: float | None = None,
    store: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    progress: bool = True,
    anyway: bool = False,
    load_errors: Mapping[str, ArrayLike] | None = None,
) -> JointDiagnoses:
    """Diagnose the joints of a machine, in parallel and resumable.

    Parameters
    ----------
    joints : mapping of str to tuple
        Nominal axis and record, or records, of each joint by its name.
    known, tolerance, window, hold, time_limit
        As for `diagnose`, the same for every joint.
    store : path-like, optional
        File that keeps each finished joint, see `run_batch`.
    jobs : int, optional
        Joints in parallel, -1 for one on each core.  Default: the setting of
        `joblib.parallel_config`, else one.
    progress : bool, optional
        Whether to show a progress bar.
    anyway : bool, optional
        Whether to go on where a record certainly has a wrong unit or sign, see `diagnose`; else its
        joint is in `failed`.
    load_errors : mapping of str to array_like, optional
        What the known load of a joint may be off, by its name, see `diagnose`.

    Returns
    -------
    JointDiagnoses
        A mapping of joints to their `Diagnosis`; `failed` has the others, and why.

    Raises
    ------
    ValueError
        If an argument is out of range, no joint can be diagnosed (the first is named in a note), or
        the store is of other settings.

    Notes
    -----
    Forces between the joints that the records do not contain are a random force to each.  A joint
    whose axis or records change is diagnosed again.

    Examples
    --------
    From one log with columns for each joint:

    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t, axes = 2e-3 * np.arange(3000), {}
    >>> log = {"time": t}
    >>> for joint, level in (("elbow", 1.5), ("wrist", 0.5)):
    ...     axes[joint] = dfc.FrictionAxis(mass=0.3, viscous=0.2, coulomb=level,
    ...                                    units=("rad", "N m"))
    ...     log[f"{joint}.effort"] = 4.0 * np.sin(3.0 * t) + 2.0 * np.sin(11.0 * t)
    ...     moved = axes[joint].simulate(log[f"{joint}.effort"], dt=2e-3).y[0]
    ...     log[f"{joint}.position"] = 1e-5 * np.round(1e5 * moved)
    >>> found = dfc.diagnose_joints(
    ...     {joint: (axis.replace(coulomb=1.0), dfc.read_record(log, joint=joint))
    ...      for joint, axis in axes.items()}, progress=False)
    >>> {joint: round(d.extended.coulomb.mean, 2) for joint, d in found.items()}
    {'elbow': 1.5, 'wrist': 0.5}
    """
    if not isinstance(joints, Mapping) or not joints:
        raise ValueError(
            f"joints must be a mapping of names to (axis, records), and not empty, got {joints!r}"
        )
    known, tolerance = checked_knowledge(known, tolerance)
    if time_limit is not None:
        time_limit = positive("time_limit", time_limit, unit="s")
    cases = _checked_cases(joints, {} if load_errors is None else load_errors)
    options = {"known": list(known), "tolerance": dict(tolerance), "time_limit": time_limit}
    free_runs: dict[str, Any] = {"window": window, "hold": hold}
    task = functools.partial(_diagnose_joint, options | free_runs | {"anyway": anyway})
    run = free_runs | {"store": store, "jobs": jobs, "progress": progress, "anyway": anyway}
    run["settings"] = {"task": "diagnose joints", **options}
    found = run_cases(task, "joints", cases, **run, own=lambda axis: (fingerprint(axis),))
    failed = {
        name: failure_entry(one)["reason"] for name, one in found.items() if failure_entry(one)
    }
    done = {name: one for name, one in found.items() if name not in failed}
    return JointDiagnoses({name: from_plain(one, _SAVED) for name, one in done.items()}, failed)


def _checked_cases(joints: Mapping[str, Any], load_errors: Any) -> dict[Any, _Case]:
    """The case of each joint, of what `diagnose_joints` takes."""
    if not isinstance(load_errors, Mapping):
        raise ValueError(
            f"load_errors must be a mapping of names of joints to forces, got {load_errors!r}"
        )
    for name in load_errors:
        if name not in joints:
            raise ValueError(f"load_errors: {name!r} is no joint; they are {', '.join(joints)}")
    cases: dict[Any, _Case] = {}
    for name, pair in joints.items():
        if not isinstance(pair, (tuple, list)) or len(pair) != 2:
            raise ValueError(f"joints[{name!r}] must be (axis, records), got {pair!r}")
        instance(f"joints[{name!r}][0]", pair[0], FrictionAxis)
        records = checked_records(pair[1], f"joints[{name!r}][1]")
        errors = checked_load_errors(load_errors.get(name), records)
        cases[name] = pair[0], records, errors
    return cases


def _diagnose_joint(options: dict[str, Any], case: _Case) -> Any:
    axis, records, errors = case
    record = records[0] if len(records) == 1 else records
    if len(errors):
        options = options | {"load_errors": errors}
    # Joints already run in parallel.
    return to_plain(diagnose(axis, record, jobs=1, progress=False, **options), _SAVED)
