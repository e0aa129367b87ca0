"""Linear regression of the drives of an arm on friction, masses, payloads, scales and clocks.

The force that the joints need beyond the model, at samples in which they slide, is linear in the
inertial parameters of the links (Atkeson, An and Hollerbach 1986)::

    u_j - tau_j = friction of joint j + sum_l Y_jl (p_l - nominal p_l) + noise

with the same smoothing of both sides.  Friction of each joint takes part by its own columns, model
errors by columns that all joints share: so an error is named once, not as a gravity of each joint.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dryfric_control.arm.rigid_model import Link, Motion
from dryfric_control.arm.wrong_log import HARDLY
from dryfric_control.arrays import Bools, Floats, Ints
from dryfric_control.estimation.force_residual import Sliding, directions

if TYPE_CHECKING:
    from dryfric_control.arm.arm_records import ArmRecords

# Gain of the logarithm of the evidence from which an error is one, as for a cause of a diagnosis.
_LEAST_GAIN = 6.0
# Difference of evidence below which another error is an alternative.
_ALIKE = 3.0
# Standard deviations of the errors that a model may have before the log is seen.
# Mass of a link, as a part of it.
_MASS = 0.15
# Centre of mass of a link, as a part of its distance from the joint.
_CENTRE = 0.1
# Centre of mass of a link, in addition [m].
_CENTRE_MORE = 0.01
# Payload [kg].
_PAYLOAD = 5.0
# Distance of the payload from the frame of the last link [m].
_REACH = 0.3
# Armature of a joint, over its mean inertia.
_ARMATURE = 0.3
# Offset of the drive, over the Coulomb level.
_OFFSET = 0.1
# Stribeck parts, over the Coulomb level.
_PEAK = 0.5
# Friction per transmitted force.
_BY_LOAD = 0.2
# Scale of the drive, relative.
_GAIN = 0.1
# Time by which the clock of a joint is behind the others [s].
_LATE = 5e-3
# Least time by which a clock is behind that is named, over the sampling time: less does no harm,
# and is below the errors of the linear model, whose friction is approximate.
_LEAST_LATE = 0.25
# Velocities of Stribeck parts, over the usual large velocity: one falls between two of them.
_PEAKS = (0.02, 0.04, 0.08, 0.16, 0.32)
# Standard deviation of the moment of inertia of a payload about its own centre [kg m^2].
_OWN_INERTIA = 2e-3
# Least mass of a payload [kg].
_LEAST = 0.05
# Largest distance of a payload from the frame of its link, in each direction [m].
_FARTHEST = 1.0
# Part of the rows that must be left without those in which another joint starts or stops.
_LEAST_ROWS = 0.5
# Most samples of a joint.
_MOST = 3000
# Rounds of weights.
_ROUNDS = 4
# Residuals of a block.
_BLOCK = 10
# Degrees of freedom of Student's distribution.
_FREEDOM = 4.0


class Compact(NamedTuple):
    """A payload about which a regression is linear; without a place, any body."""

    mass: float = 0.0
    place: Floats | None = None

    def columns(self, regressor: Floats) -> tuple[Floats, Floats]:
        """Columns of its parameters, shape (nrows, k), and their standard deviations beforehand."""
        if self.place is None:
            return regressor, _PAYLOAD * np.array([1.0, *[_REACH] * 3, *[_REACH**2] * 6])
        # Of a mass m at p: 1, m p and second moments; about p = place + shift, m fixed there.
        columns = np.zeros((10, 5))
        columns[0, 0], columns[1:4, 0] = 1.0, self.place
        columns[4:, 0] = second_moments(self.place)
        for k in range(3):
            ends = (second_moments(self.place + s * np.eye(3)[k]) for s in (0.5, -0.5))
            columns[1 + k, 1 + k] = self.mass
            columns[4:, 1 + k] = self.mass * np.subtract(*ends)
        columns[4:7, 4] = 1.0
        return regressor @ columns, np.array([_PAYLOAD, *[_REACH] * 3, _OWN_INERTIA])

    def body_parameters(self, mean: Floats) -> tuple[float, Floats, Floats]:
        """Mass, place and second moments at an estimate of its parameters."""
        if self.place is None:
            return float(mean[0]), mean[1:4] / max(float(mean[0]), _LEAST), mean[4:]
        mass = float(mean[0])
        place = self.place + mean[1:4] * self.mass / max(mean[0], _LEAST)
        second = mass * second_moments(place)
        # No body has less inertia than a point of its mass.
        second[:3] += max(float(mean[4]), 0.0)
        return mass, place, second


def second_moments(place: Floats) -> Floats:
    """Second moments of 1 kg at a place, in the order of the inertial parameters."""
    x, y, z = place
    return np.array([y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z])


class Group(NamedTuple):
    """Columns that act together: one possible error."""

    kind: str  # "mass", "centre", "payload" of a link, "masses" of all, "drive", "clock" of a joint
    of: str  # name of the link or joint
    columns: Floats  # shape (nrows, k), each for a deviation of 1
    spread: Floats  # standard deviations before the record is seen, shape (k,)
    payload: Compact | None = None

    @property
    def name(self) -> str:
        """Such as "mass of upper"."""
        return {
            "mass": "mass of {}", "masses": "masses of all links", "payload": "payload at {}",
            "centre": "centre of mass of {}", "drive": "scale of the drive of {}",
            "clock": "clock of {}",
        }[self.kind].format(self.of)  # fmt: skip


class Rows(NamedTuple):
    """Samples in which joints slide, one joint after the other."""

    y: Floats  # force beyond the model, shape (nrows,)
    joint: Ints  # number of the joint
    own: Floats  # columns of the friction of the joints, shape (nrows, k)
    spread: Floats  # standard deviations of their coefficients beforehand, inf for any
    regressor: Floats  # shape (nrows, nlinks, 10)
    force: Floats  # of the model without friction
    behind: Floats  # force beyond the model per second by which a joint is behind, (nrows, njoints)
    dt: float  # sampling time [s]

    @property
    def least_late(self) -> float:
        """Least time by which a clock is behind that is named [s]."""
        return _LEAST_LATE * self.dt


def sliding_rows(
    records: ArmRecords, links: Sequence[Link], most: int = _MOST, clocks: bool = True
) -> Rows:
    """Rows of the regression of all joints: at most some of each, with columns of their clocks.

    Each is a mean over a window of the smoothing, in which the joint slides in one direction.
    Errors of accelerations half a window apart nearly cancel: as errors of their own they would
    pass for a shift of the acceleration, which is what a clock does.
    """
    arm = records.arm
    parts = []
    spreads = []
    unsteady = _unsteady(records)
    for j, (joint, (axis, record)) in enumerate(records.items()):
        sliding = Sliding(record, smooth_drive=True)
        step = max(sliding.smoothing // 2, sliding.t.size // most, 1)
        pick = np.searchsorted(record.t, sliding.t)
        # A start or stop of another joint is smeared over the smoothing.
        rows = np.flatnonzero(~unsteady[pick])
        if rows.size < _LEAST_ROWS * pick.size:
            rows = np.arange(pick.size)
        rows = rows[::step]
        halves = _halves_of_windows(pick[rows], sliding.direction[rows], step)
        rows = rows[halves]
        pick = pick[rows]
        u = sliding.u[rows]
        direction = sliding.direction[rows].astype(float)
        motion = Motion(*(one[pick] for one in records.motion_of(joint)))
        force, _ = arm.forces(motion)
        behind = np.zeros((pick.size, len(records)))
        if clocks:
            behind = _force_of_delays(records, joint, pick)
        regressor = arm.regression_matrix(motion, links)[:, j]
        v = motion.v[:, j]
        a = motion.a[:, j]
        level = axis.coulomb.mean
        fast = float(np.quantile(np.abs(v), 0.9)) if v.size else 1.0
        peaks = [direction * np.exp(-((v / (part * fast)) ** 2)) for part in _PEAKS]
        # By the model and a first friction: the measured drive in a column would explain itself.
        plain = np.stack([direction, v], axis=1)
        friction = plain @ np.linalg.lstsq(plain, u - force[:, j], rcond=None)[0]
        carried = direction * np.abs(2.0 * force[:, j] - axis.mass * a + friction)
        own = np.stack([direction, v, a, np.ones(v.size), carried, *peaks], axis=1)
        spreads += [
            math.inf, math.inf, _ARMATURE * axis.mass, _OFFSET * level, _BY_LOAD,
            *[_PEAK * level] * len(peaks),
        ]  # fmt: skip
        means = [
            _means_of_halves(one) for one in (u - force[:, j], own, regressor, force[:, j], behind)
        ]
        parts.append((means[0], np.full(means[0].size, j), *means[1:]))
    count = [part[2].shape[1] for part in parts]
    own = np.zeros((sum(part[0].size for part in parts), sum(count)))
    row = column = 0
    for part in parts:
        own[row : row + part[0].size, column : column + part[2].shape[1]] = part[2]
        row = row + part[0].size
        column = column + part[2].shape[1]
    y, number, regressor, force, behind = (
        np.concatenate([part[i] for part in parts]) for i in (0, 1, 3, 4, 5)
    )
    dt = next(iter(records.records.values())).dt
    return Rows(y, number, own, np.array(spreads), regressor, force, behind, dt)


def _halves_of_windows(at: Ints, direction: Ints, step: int) -> Ints:
    """Rows, two and two, that follow each other by a step in one direction."""
    index = np.arange(at.size)
    follows = np.zeros(at.size, bool)
    follows[1:] = (np.diff(at) == step) & (np.diff(direction) == 0)
    place = index - np.maximum.accumulate(np.where(follows, 0, index))
    second = np.flatnonzero(follows & (place % 2 == 1))
    return np.ravel(np.stack([second - 1, second], axis=1))


def _means_of_halves(column: Floats) -> Floats:
    """Means of two rows each."""
    return np.asarray(0.5 * (column[::2] + column[1::2]))


def _unsteady(records: ArmRecords) -> Bools:
    """Samples within the smoothing of a start or stop of any joint, shape (n,)."""
    found = np.zeros(len(records.motion.q), bool)
    for record in records.records.values():
        half = record.smoothing_window // 2
        changes = np.flatnonzero(np.diff(directions(record)) != 0)
        for offset in range(-half, half + 2):
            found[np.clip(changes + offset, 0, found.size - 1)] = True
    return found


def _force_of_delays(records: ArmRecords, joint: str, pick: Ints) -> Floats:
    """Force of a joint beyond the model per second by which a clock is behind, (n, njoints)."""
    found = np.empty((pick.size, len(records)))
    for k, name in enumerate(records):
        ends = []
        # Over as long a time as a clock may be off: a slope would have the noise of the jerk.
        for late in (-_LATE, _LATE):
            moved = records.motion_of(joint, {name: late})
            force = records.arm.force_alone(Motion(*(one[pick] for one in moved)))
            ends.append(force[:, list(records).index(joint)])
        found[:, k] = (ends[1] - ends[0]) / (2.0 * _LATE)
    return found


def link_groups(
    regressor: Floats, links: Sequence[Link], payloads: Mapping[str, Compact]
) -> list[Group]:
    """Masses, centres and payloads of links, by forces per inertial parameter, (n, k, 10)."""
    found = []
    for i, link in enumerate(links):
        own = regressor[:, i]
        if link.mass > 0.0:
            found.append(Group("mass", link.name, own @ link.inertial[:, None], np.array([_MASS])))
            reach = _CENTRE * float(np.linalg.norm(link.inertial[1:4])) / link.mass + _CENTRE_MORE
            shift = link.mass * own[:, 1:4]
            found.append(Group("centre", link.name, shift, np.full(3, reach)))
        if link.last:
            columns, spread = payloads[link.name].columns(own)
            found.append(Group("payload", link.name, columns, spread, payloads[link.name]))
    return found


def groups_of(
    rows: Rows, links: Sequence[Link], joints: Sequence[str], payloads: Mapping[str, Compact]
) -> list[Group]:
    """What may be wrong."""
    found = link_groups(rows.regressor, links, payloads)
    masses = np.concatenate([one.columns for one in found if one.kind == "mass"], axis=1)
    some = ", ".join(one.of for one in found if one.kind == "mass")
    found.append(Group("masses", some, masses, np.full(masses.shape[1], _MASS)))
    for j, joint in enumerate(joints):
        # A drive that acts by a factor 1 + g of what was recorded: all forces are in ratio to it.
        # Not by columns of the drive, which with masses of none would explain any record.
        scale = np.where(rows.joint == j, -rows.force, 0.0)
        found.append(Group("drive", joint, scale[:, None], np.array([_GAIN])))
        if len(joints) > 1:
            found.append(Group("clock", joint, rows.behind[:, j : j + 1], np.array([_LATE])))
    return found


class Solved(NamedTuple):
    """Estimate of a group."""

    mean: Floats
    covariance: Floats


class Estimate(NamedTuple):
    """A group beside others, estimated."""

    group: Group
    mean: Floats  # shape (k,)
    standard_errors: Floats  # shape (k,)
    gain: float  # of the logarithm of the evidence
    alternatives: tuple[str, ...]  # groups that explain the rows as well


class Regression:
    """Linear model of all joints with any of the groups of columns.

    Parameters
    ----------
    rows : Rows
    groups : sequence of Group
    """

    def __init__(self, rows: Rows, groups: Sequence[Group]) -> None:
        self.rows, self.groups = rows, list(groups)
        self._columns = np.concatenate([rows.own, *(group.columns for group in groups)], axis=1)
        spread = np.concatenate([rows.spread, *(group.spread for group in groups)])
        self._precision = 1.0 / spread**2
        ends = rows.own.shape[1] + np.cumsum([group.spread.size for group in groups])
        self._at = [np.arange(e - g.spread.size, e) for e, g in zip(ends, groups, strict=True)]
        self._weight_rows(np.ones(rows.y.size), np.ones(rows.y.size))
        self._settle(range(len(self.groups)))

    def _weight_rows(self, noise: Floats, weight: Floats) -> None:
        """Normal equations of all columns, at the noise and weight of each row."""
        scale = weight / noise**2
        self._normal = self._columns.T @ (self._columns * scale[:, None])
        self._right = self._columns.T @ (self.rows.y * scale)

    def _settle(self, some: Sequence[int]) -> None:
        """Noise of each joint, and weights of Student's distribution, with some of the groups."""
        noise = np.ones(self.rows.y.size)
        weight = np.ones(self.rows.y.size)
        for _ in range(_ROUNDS):
            left = self.residuals(some)
            for j in range(int(self.rows.joint.max(initial=-1)) + 1):
                mine = self.rows.joint == j
                e = left[mine]
                spread = 1.4826 * float(np.median(np.abs(e))) or 1e-12
                weight[mine] = (_FREEDOM + 1.0) / (_FREEDOM + (e / spread) ** 2)
                # What is correlated over rows counts as fewer of them.
                noise[mine] = spread * math.sqrt(_variance_inflation(e, weight[mine]))
            self._weight_rows(noise, weight)

    def residuals(self, some: Iterable[int]) -> Floats:
        """Force that friction and some of the groups do not explain, shape (nrows,)."""
        pick = self._pick(some)
        found = np.linalg.solve(self._information(pick), self._right[pick])
        return np.asarray(self.rows.y - self._columns[:, pick] @ found)

    def unlikely_links(self, chosen: Sequence[int]) -> list[str]:
        """Links with masses or centres that are as hardly any model has them wrong."""
        found = set[str]()
        for i, (mean, _) in self.solve_groups(chosen).items():
            group = self.groups[i]
            if group.kind in ("mass", "masses"):
                off = np.abs(mean) > HARDLY * group.spread
                found |= {of for of, one in zip(group.of.split(", "), off, strict=True) if one}
            elif group.kind == "centre" and bool((np.abs(mean) > HARDLY * group.spread).any()):
                found.add(group.of)
        return sorted(found)

    def _pick(self, some: Iterable[int]) -> Ints:
        """Columns of the friction, and of some groups."""
        own = np.arange(self.rows.own.shape[1])
        return np.concatenate([own, *(self._at[i] for i in some)])

    def _information(self, pick: Ints) -> Floats:
        """Normal matrix of columns with what is known beforehand."""
        normal = self._normal[np.ix_(pick, pick)] + np.diag(self._precision[pick])
        # No column may be without any information.
        normal[np.diag_indices_from(normal)] += 1e-10 * np.diag(normal) + 1e-12
        return np.asarray(normal)

    def evidence(self, some: Iterable[int]) -> float:
        """Logarithm of the probability of the rows, up to a constant."""
        pick = self._pick(some)
        normal = self._information(pick)
        right = self._right[pick]
        precision = self._precision[pick]
        fit = float(right @ np.linalg.solve(normal, right))
        volume = float(np.linalg.slogdet(normal)[1] - np.log(precision[precision > 0.0]).sum())
        return 0.5 * (fit - volume)

    def search(self, right: Collection[str] = ()) -> list[int]:
        """Groups with evidence beside each other; `right`: joints whose clocks are right."""
        chosen: list[int] = []
        now = self.evidence(chosen)
        while len(chosen) < len(self.groups):
            kinds = {self.groups[i].kind for i in chosen}
            rest = [
                i for i, group in enumerate(self.groups)
                if i not in chosen and not (group.kind == "mass" and "masses" in kinds)
                and not (group.kind == "clock" and group.of in right)
            ]  # fmt: skip
            gains = [self._gain([*chosen, i], now) for i in rest]
            best = int(np.argmax(gains))
            if gains[best] < _LEAST_GAIN:
                break
            chosen.append(rest[best])
            now += gains[best]
            for i in list(chosen):
                without = [k for k in chosen if k != i]
                if i != chosen[-1] and now - self.evidence(without) < _LEAST_GAIN:
                    chosen = without
                    now = self.evidence(without)
        return chosen

    def update_payloads(self, before: Mapping[str, Compact]) -> tuple[dict[str, Compact], float]:
        """Payloads beside masses of links, and the change of their places [m]."""
        some = [i for i, group in enumerate(self.groups) if group.kind in ("masses", "payload")]
        solved = self.solve_groups(some)
        found = dict[str, Compact]()
        change = 0.0
        for i in some:
            group = self.groups[i]
            if group.payload is None:
                continue
            mass, place, _ = group.payload.body_parameters(solved[i].mean)
            mass = max(mass, _LEAST)
            last = before[group.of].place
            place = np.clip(place, -_FARTHEST, _FARTHEST)
            change = max(change, math.inf if last is None else float(np.abs(place - last).max()))
            found[group.of] = Compact(mass, place)
        return found, change

    def _gain(self, some: Sequence[int], before: float) -> float:
        """Gain of evidence by the last of some groups; none by one too small to be an error."""
        last = some[-1]
        kind = self.groups[last].kind
        if kind == "payload" and self.solve_groups(some)[last].mean[0] <= 0.0:
            return -math.inf
        if kind == "clock":
            late = abs(float(self.solve_groups(some)[last].mean[0]))
            if late < self.rows.least_late:
                return -math.inf
        return self.evidence(some) - before

    def solve_groups(self, chosen: Sequence[int]) -> dict[int, Solved]:
        """Estimates of the chosen groups."""
        pick = self._pick(chosen)
        covariance = np.asarray(np.linalg.inv(self._information(pick)), dtype=float)
        mean = covariance @ self._right[pick]
        at = self.rows.own.shape[1]
        found = {}
        for i in chosen:
            part = slice(at, at + self.groups[i].spread.size)
            found[i] = Solved(mean[part], covariance[part, part])
            at = part.stop
        return found

    def root_of_covariance(self) -> Floats:
        """Root of the covariance of all groups together, a column each direction."""
        pick = self._pick(range(len(self.groups)))
        covariance = np.linalg.inv(self._information(pick))
        own = self.rows.own.shape[1]
        values, vectors = np.linalg.eigh(covariance[own:, own:])
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def estimates(self, chosen: Sequence[int]) -> Iterator[Estimate]:
        """The chosen groups, each with what its evidence rests on."""
        now = self.evidence(chosen)
        solved = self.solve_groups(chosen)
        for i in chosen:
            group, (mean, covariance) = self.groups[i], solved[i]
            without = [k for k in chosen if k != i]
            others = tuple(
                one.name for k, one in enumerate(self.groups)
                if k not in chosen and not {one.kind, group.kind} == {"mass", "masses"}
                and now - self.evidence([*without, k]) < _ALIKE
            )  # fmt: skip
            gain = now - self.evidence(without)
            yield Estimate(group, mean, np.sqrt(np.diag(covariance)), gain, others)


def _variance_inflation(e: Floats, weight: Floats) -> float:
    """Variance of means of blocks of rows, over that of independent rows; at least 1."""
    count = e.size // _BLOCK
    if count < 4:
        return 1.0
    blocks = (e * weight)[: count * _BLOCK].reshape(count, _BLOCK)
    single = float(np.mean(blocks**2))
    return max(float(np.mean(blocks.sum(axis=1) ** 2)) / (_BLOCK * single), 1.0) if single else 1.0
