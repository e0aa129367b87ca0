"""Normal equations of all candidate effects beside one model, and proposals from them."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from dryfric_control.compiled import likelihood as compiled
from dryfric_control.diagnosis.candidates import (
    Start,
    effect_class,
    excluded_actions,
    form_of,
    forms,
    repeat_apart,
    with_effect,
    with_held,
)
from dryfric_control.diagnosis.linearised import Linearised
from dryfric_control.diagnosis.model_view import CHANGED, ModelView
from dryfric_control.diagnosis.problem import Problem, each_of, noises_of
from dryfric_control.diagnosis.thresholds import (
    MAX_CAUSES,
    MAX_JOINED_CAUSES,
    MAX_OTHER_SHAPES,
    MAX_SAME_RESIDUAL,
    MAX_SCREENING_FORCE,
    MAX_SINGLE_PROPOSALS,
    MIN_EXCHANGE_GAIN,
    MIN_PREDICTED_GAIN,
    MIN_SCREENING_FORCE,
    NEGLIGIBLE_RATIO,
    NOISE_SCALE_ITERATIONS,
    SCREENING_FORCE_FACTORS,
)
from dryfric_control.estimation.likelihood import (
    BASE,
    BASE_LOG_DEVIATION,
    Likelihood,
    Point,
    joint_nominal_error_cost,
    load_error_names,
    nominal_error_cost,
)
from dryfric_control.estimation.parameters import values_of, with_values
from dryfric_control.estimation.solution import Solution
from dryfric_control.model.axis import FrictionAxis
from dryfric_control.model.effects.columns import (
    Column,
    View,
    difference,
    effect_contribution,
    simulated_column,
)
from dryfric_control.model.effects.effect import Effect
from dryfric_control.model.effects.naming import named, next_of_kind

FloatArray = NDArray[np.float64]

#: Name of the columns of friction that builds up after reversals, which belong to no one effect.
REVERSAL = "after reversal"

#: An effect and its form.
_Form = tuple[str, tuple[str, ...]]

# Coefficient with which any effect can exist.
_SMALL = 1e-3
# Largest change of an innovation by a simulated shape [standard deviations].
_MAX_INNOVATION_CHANGE = 30.0
# Bounds of the factor of a base parameter in the start of a fit.
_BASE_FACTOR_LIMITS = (0.4, 2.5)
# Number of columns whose responses are computed at once.
_COLUMN_BATCH = 32
# Ridge of the normal equations, in their unit diagonal.
_RIDGE = 1e-9
# Part of the largest gain of a shape with a memory, in passes of the filter, that another one must
# have to be fitted.
_MIN_GAIN_FRACTION = 0.05
# Largest part of the samples on a stretch on which shapes with a memory are put in order.
_MAX_STRETCH_PART = 0.7
# Number of shapes of each effect with a memory that take passes of the whole records.
_FULL_SHAPES = 4
# Least ratio of the number of independent samples after to before for what takes from the drive.
_MIN_INDEPENDENCE_RATIO = 0.8
# Largest part of the drive that a cause in the drive may take.
_MAX_DRIVE_FRACTION = 0.5


def _level(effect: type[Effect]) -> bool:
    """Whether an effect raises the level of friction."""
    return effect.action == "friction" or effect.axis_field == "stribeck"


def _builds_up(name: str) -> bool:
    """Whether friction builds up after reversals by an effect, or by what has this name."""
    return name == REVERSAL or effect_class(name).action in ("contact", "transmission")


@dataclass(frozen=True)
class Item:
    """One shape of an effect."""

    name: str  # the effect's name in the axis
    column: Column
    at: tuple[int, ...]  # places in the matrix
    gain: float = -math.inf  # gain of log-likelihood in one pass, if it was simulated
    form: tuple[str, ...] = ()  # amounts of that form of the effect, if it was simulated

    @property
    def repeats(self) -> bool:
        """Whether an axis may have several of the effect."""
        return self.name != REVERSAL and effect_class(self.name).repeats

    @property
    def is_made_of_drive(self) -> bool:
        """Whether its force is a part of the drive, or of the load that it holds."""
        if self.name == REVERSAL or not self.column.force:
            return False
        effect = effect_class(self.name)
        return effect.action == "input" or effect.loaded()

    @cached_property
    def example(self) -> Effect:
        """The effect with small coefficients, which any effect may have."""
        columns = self.column.force or self.column.reading
        return effect_class(self.name)(**self.column.values([_SMALL] * len(columns)))


@dataclass(frozen=True)
class Proposal:
    """An axis with effects added, from which a fit starts."""

    names: tuple[str, ...]  # the effects
    axis: FrictionAxis
    free: tuple[str, ...]  # their free parameters
    cost: float  # in one pass, the size of all noises fitted, less that of the model there
    predicted: float  # gain of log-likelihood that the normal equations predict
    held: FrictionAxis | None = None  # the same with the base parameters of the model
    remembers: tuple[str, ...] = ()  # those of shapes that were simulated
    quieter: float = 1.0  # factor of the random force of that pass


def screening_noises(problem: Problem, fit: Solution) -> FloatArray:
    """Noises of a fit with the random force within parts of the drive.

    With next to no random force a switch at another sample counts as an outlier and what acts
    rarely is not seen; with too much the filter follows the readings, whatever the model.
    """
    z = noises_of(fit).copy()
    for i, run in enumerate(problem.runs):
        low, high = (
            2.0 * math.log(part * run.drive) for part in (MIN_SCREENING_FORCE, MAX_SCREENING_FORCE)
        )
        z[2 * i] = min(max(z[2 * i], low), high)
    return z


def with_force_factor(noises: FloatArray, part: float) -> FloatArray:
    """Noises with the random force of each record times a factor."""
    z = noises.copy()
    z[::2] += 2.0 * math.log(part)
    return z


def profiled_cost(likelihood: Likelihood, point: Point) -> float:
    """Cost without prior, one factor of all variances fitted; infinite without a result."""
    if not point.out:
        return math.inf
    pairs = zip(likelihood.runs, point.out, strict=True)
    total = sum(
        compiled.profile_cost(out, run.active, NOISE_SCALE_ITERATIONS) for run, out in pairs
    )
    return total if math.isfinite(total) else math.inf


@dataclass(eq=False)
class Gram:
    """Normal equations of the columns of some effects beside a model.

    Shapes that take a pass of the filter each come with `simulate` alone.
    """

    problem: Problem
    fit: Solution  # the model
    names: Sequence[str]  # effects that may be added, by their names in the axis
    fail: Callable[[str, str], None]  # called with an effect and the reason why it was not tried
    #: What the model is compared with: its innovations if not given.
    view: ModelView | None = None
    #: The model beside which starts are fitted, if that is another one.
    beside: Solution | None = None
    items: list[Item] = field(default_factory=list)
    #: Logarithm of the number of shapes of each effect that were searched.
    odds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        problem = self.problem
        fit = self.fit
        self.noises = screening_noises(problem, fit)
        z = np.concatenate((fit.z[: len(fit.problem.names)], self.noises))
        self.likelihood, self.z = self._rigid(fit.problem, z)
        self.here = here = self.view or Linearised(problem, self.likelihood, self.z)
        self.base = [n for n in problem.base if n in fit.problem.names]
        self.base = [n for n in self.base if n not in self._out_of_bounds()]
        self._now = values_of(here.axis, self.base)
        others = [n for n in self.likelihood.names if n not in self.base]
        own = here.steps(others)
        # Standard deviations of load errors are known.
        self._known_spread = np.isin(others, load_error_names(problem.runs))
        fixed = np.concatenate((here.base(self.base), own), axis=1) if self.base else own
        here.project_out(fixed)
        self.fixed, self._blocks = fixed.shape[1], [fixed]
        self._proposed = set[frozenset[_Form]]()
        self.total, self.count = float(here.y @ here.y), here.count
        self._add(itertools.chain(self._columns(), self._after_reversal()))

    def _after_reversal(self) -> Iterator[tuple[str, Column, FloatArray, float]]:
        forces = [*self.here.after_reversal()]
        values = self.here.of_forces(forces)
        for j, force in enumerate(forces):
            column = Column(lambda c: {}, (force,), shapes=len(forces))
            yield REVERSAL, column, np.nan_to_num(values[:, [j]]), -math.inf

    def simulate(self) -> None:
        """Add the shapes without force columns."""
        self._add(self._simulated_shapes())

    def _add(self, added: Iterator[tuple[str, Column, FloatArray, float]]) -> None:
        """Add shapes with their columns to the normal equations."""
        problem = self.problem
        here = self.here
        at = sum(block.shape[1] for block in self._blocks)
        for name, column, values, gain in added:
            width = values.shape[1]
            form = form_of(name, column.values((1.0,))) if gain > -math.inf else ()
            self.items.append(Item(name, column, tuple(range(at, at + width)), gain, form))
            self._blocks.append(values)
            at += width
        c = np.concatenate(self._blocks, axis=1)
        self.scale = np.maximum(np.linalg.norm(c, axis=0), 1e-300)
        c /= self.scale
        self.g, self.b = c.T @ c, -(c.T @ here.y)
        ridge = np.full(self.fixed, 1e-6)
        ridge[: len(self.base)] = [
            problem.tolerance.get(n, BASE_LOG_DEVIATION) ** -2
            if n in BASE and problem.nominal[n] > 0.0
            else 1e-6
            for n in self.base
        ]
        ridge[len(self.base) :][self._known_spread] = 1.0
        self._ridge = ridge / np.maximum(self.scale[: self.fixed] ** 2, 1e-300)
        self._unit = 1.0
        self.g[np.diag_indices(self.fixed)] += self._ridge
        # Bounds of the coefficients: the first column of an item is its amount.
        self.least, self.most = np.full(at, -np.inf), np.full(at, np.inf)
        for one in self.items:
            self.least[one.at[0]] = 0.0 if one.column.positive else -np.inf
            self.most[one.at[0]] = min(one.column.most, self._drive_share(one))
        for name in ("_best_shapes", "_matrix", "after_reversal"):
            vars(self).pop(name, None)
        for name in (*self.names, REVERSAL):
            some = [i.column for i in self.items if i.name == name]
            shapes = max([len(some), *(one.shapes for one in some)], default=1.0)
            self.odds[name] = math.log(max(min(shapes, 0.1 * self.count), 1.0))

    def _drive_share(self, one: Item) -> float:
        """Largest coefficient of a force that does what the drive does: half of the drive.

        Beyond, it mutes the drive, and the base with it.
        """
        if self.problem.is_imposed or not one.is_made_of_drive:
            return math.inf
        slides = self.here.direction != 0.0
        size = float(np.linalg.norm(one.column.force[0][slides]))
        return _MAX_DRIVE_FRACTION * float(np.linalg.norm(self.here.u[slides])) / max(size, 1e-300)

    def _rigid(self, likelihood: Likelihood, z: FloatArray) -> tuple[Likelihood, FloatArray]:
        """Where the pass is: two masses on a spring, which have no scalar gains, are one mass."""
        axis = likelihood.axis_at(z, 0)
        effects = named(axis).items()
        spring = next((n for n, e in effects if e.inner(axis).stiffness > 0.0), None)
        if spring is not None:
            bare = self.problem.remove_effects(axis, spring)
            free = [n for n in self.problem.free_of(self.fit) if not n.startswith(f"{spring}.")]
            likelihood = self.problem.likelihood(bare, free, each=each_of(self.fit))
            z = likelihood.start(noises=self.noises)
        return likelihood, z

    def _out_of_bounds(self) -> list[str]:
        """Amounts of nominal effects that the residual would take to a sign they cannot have.

        They stay as they are, so that another effect, or the same with other numbers, joins.
        """
        amounts = [n for n in self.base if n not in BASE]
        if not amounts:
            return []
        columns = self.here.base(self.base)
        change = np.linalg.lstsq(columns, -self.here.y, rcond=1e-9)[0]
        low = {p.name: p.low for p in self.likelihood.parameters}
        return [
            n
            for n, c in zip(self.base, change, strict=True)
            if n in amounts and low[n] >= 0.0 and 1.0 + c < 0.0
        ]

    @cached_property
    def _shapes(self) -> dict[str, list[Column]]:
        """Shapes of all effects, by name."""
        found = dict[str, list[Column]]()
        present = named(self.problem.believed)
        for name in self.names:
            try:
                if name in present:
                    view = cast(View, self.here)
                    found[name] = [*present[name].changes(view)] or [
                        *_changed_effects(name, present[name], self.base, view),
                        *_other_amounts(name, present[name], view),
                    ]
                else:
                    found[name] = [*effect_class(name).columns(cast(View, self.here))]
                if _level(effect_class(name)):
                    found[name] = [
                        one._replace(force=tuple(map(self.here.behind_bristles, one.force)))
                        for one in found[name]
                    ]
            except (ValueError, ArithmeticError) as problem:
                self.fail(name, str(problem))
        return found

    @property
    def is_told(self) -> bool:
        """Whether the record itself tells the values of a shape that takes a pass."""
        return any(one.told for some in self._shapes.values() for one in some)

    def _columns(self) -> Iterator[tuple[str, Column, FloatArray, float]]:
        """Shapes of all effects with their weighted columns."""
        for kind, respond in (("force", self.here.of_forces), ("reading", self.here.of_readings)):
            waiting = [
                (name, one)
                for name, some in self._shapes.items()
                for one in some
                if getattr(one, kind)
            ]
            for k in range(0, len(waiting), _COLUMN_BATCH):
                some = waiting[k : k + _COLUMN_BATCH]
                values = respond([a for _, one in some for a in getattr(one, kind)])
                at = 0
                for name, one in some:
                    width = len(getattr(one, kind))
                    yield name, one, np.nan_to_num(values[:, at : at + width]), -math.inf
                    at += width

    def _simulated_shapes(self) -> Iterator[tuple[str, Column, FloatArray, float]]:
        """Shapes without force columns, from a pass of the filter each."""
        tasks = [
            (name, one)
            for name, some in self._shapes.items()
            for one in some
            if not (one.force or one.reading)
        ]
        levels = self._levels
        if tasks and self.likelihood is not self.fit.problem:
            levels = self._costs(self.likelihood, self._parts)

        def run(name: str, column: Column) -> tuple[FloatArray, float] | None:
            if self.problem.is_overdue:
                return None
            try:
                likelihood = self._simulated(name, column)
                z = likelihood.start(noises=self.noises)
                point = likelihood.at(z)
                here = profiled_cost(likelihood, point) + likelihood.prior(z)
                costs = (here, *self._costs(likelihood, self._parts[1:]))
                gain = max(level - one for level, one in zip(levels, costs, strict=True))
                return self.here.of_change(point, _MAX_INNOVATION_CHANGE)[:, None], gain
            except ValueError as problem:
                self.fail(name, str(problem))
                return None

        tasks = self._promising_shapes(tasks)
        found = self.problem.parallel(run, *(zip(*tasks, strict=True) if tasks else ((), ())))
        if not self.problem.is_overdue:
            self._note_no_numbers([name for name, _ in tasks], found)
        for (name, column), row in zip(tasks, found, strict=True):
            if row is not None and np.any(row[0]):
                yield name, column, row[0], row[1]

    def _simulated(self, name: str, column: Column) -> Likelihood:
        """Likelihood of the model with a shape without force columns."""
        start = with_effect(self.here.axis, name, column.values((1.0,)))
        # Two masses on a spring are one in a pass, which has no parameters of the spring.
        effects = named(self.here.axis)
        own = [n for n in self.problem.free_of(self.fit) if n.partition(".")[0] in effects]
        return self.problem.likelihood(start.axis, (*own, *start.free), each=each_of(self.fit))

    def _promising_shapes(self, tasks: Sequence[tuple[str, Column]]) -> list[tuple[str, Column]]:
        """Of each effect the likeliest shapes on the stretch with the fastest strokes.

        A shape with a memory acts after each reversal: a few reversals put the shapes in order.
        """
        runs = self.problem.fast_stretches
        short = sum(int(r.active.sum()) for r in runs) < _MAX_STRETCH_PART * self.problem.samples
        if self.problem.is_imposed or not (short and tasks):
            return [*tasks]

        def costs(name: str, column: Column) -> list[float]:
            if self.problem.is_overdue:
                return [math.inf] * len(self._parts)
            try:
                return self._costs(self._simulated(name, column).on(runs), self._parts)
            except ValueError as problem:
                self.fail(name, str(problem))
                return [math.inf] * len(self._parts)

        rows = self.problem.parallel(costs, *zip(*tasks, strict=True))
        levels = np.min(rows, axis=0)
        with np.errstate(invalid="ignore"):  # where no shape has a likelihood
            ranks = np.nan_to_num(np.array(rows) - levels, nan=math.inf).min(
                axis=1, initial=math.inf
            )
        keys = [(name, form_of(name, column.values((1.0,)))) for name, column in tasks]
        kept = list[int]()
        for key in dict.fromkeys(keys):
            own = [k for k, other in enumerate(keys) if other == key]
            kept += sorted(own, key=ranks.__getitem__)[:_FULL_SHAPES]
        return [tasks[k] for k in sorted(kept)]

    def _note_no_numbers(
        self, names: Sequence[str], found: Sequence[tuple[FloatArray, float] | None]
    ) -> None:
        """Note effects without a likelihood at any of their shapes."""
        likely = {
            name
            for name, row in zip(names, found, strict=True)
            if row is not None and math.isfinite(row[1])
        }
        for name in dict.fromkeys(names):
            if name not in likely:
                self.fail(name, "no likelihood at any of its shapes: its law gives no numbers")

    @property
    def _parts(self) -> tuple[float, ...]:
        """Factors of the random force: of an imposed motion, which no filter follows, one."""
        return SCREENING_FORCE_FACTORS[:1] if self.problem.is_imposed else SCREENING_FORCE_FACTORS

    def _costs(
        self, likelihood: Likelihood, parts: Sequence[float], noises: FloatArray | None = None
    ) -> list[float]:
        """Costs in one pass at factors of the random force, the size of all noises fitted."""
        noises = self.noises if noises is None else noises
        costs = []
        for part in parts:
            z = likelihood.start(noises=with_force_factor(noises, part))
            costs.append(profiled_cost(likelihood, likelihood.tried(z)) + likelihood.prior(z))
        return costs

    @cached_property
    def _levels(self) -> list[float]:
        """The same of the model: a cost says nothing beside one at another random force."""
        return self._levels_of(self.fit, self.noises)

    @cached_property
    def _fit_noises(self) -> FloatArray:
        """Noises from which starts are fitted."""
        return screening_noises(self.problem, self.beside or self.fit)

    @cached_property
    def _fit_levels(self) -> list[float]:
        """Costs at these of the model beside which starts are fitted."""
        return self._levels_of(self.beside or self.fit, self._fit_noises)

    def _levels_of(self, fit: Solution, noises: FloatArray) -> list[float]:
        likelihood = self.problem.likelihood(fit.axis, self.problem.free_of(fit), each=each_of(fit))
        return self._costs(likelihood, self._parts, noises)

    def _predicted_gains(
        self, sets: Sequence[Sequence[int]], moved: bool, signed: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Predicted gains of log-likelihood of sets of items with equally many columns.

        And their coefficients, those of the free parameters first.  `moved`: whether the base
        parameters may change along; `signed`: whether amounts keep the sign they must have.
        """
        held = 0 if moved else len(self.base)
        free = range(held, self.fixed)
        index = np.array([[*free, *self._columns_of(chosen)] for chosen in sets], int)
        m = self.g[index[:, :, None], index[:, None, :]]
        m += _RIDGE * np.eye(index.shape[1])
        b = self.b[index]
        c = np.linalg.solve(m, b[:, :, None])[:, :, 0]
        explained = (b * c).sum(axis=1) / max(self.total, 1e-300)
        c /= self.scale[index]
        none = np.abs(c) > self.most[index]
        if signed:
            none |= c <= self.least[index]
        c = np.concatenate((np.zeros((len(sets), held)), c), axis=1)
        left = np.maximum(1.0 - explained, 1e-12)
        gain = -0.5 * self.count * np.log(left) - self._assumption_cost(c)
        return np.where(none.any(axis=1), -np.inf, gain), c

    def _columns_of(self, chosen: Sequence[int]) -> list[int]:
        """Columns of a set of items."""
        return [j for g in chosen for j in self.items[g].at]

    def gains(self, sets: Sequence[Sequence[int]]) -> list[float]:
        """Predicted gains of some sets of items, the base as it is or moved along."""
        found = [0.0] * len(sets)
        widths = [len(self._columns_of(chosen)) for chosen in sets]
        for width in set(widths):
            some = [k for k, w in enumerate(widths) if w == width]
            alike = [sets[k] for k in some]
            moved = self._predicted_gains(alike, True)[0]
            held = self._predicted_gains(alike, False)[0]
            for k, gain in zip(some, np.maximum(moved, held).tolist(), strict=True):
                found[k] = gain
        return found

    def _residual_of(self, chosen: Sequence[int]) -> FloatArray:
        """Residual that a set of items leaves, the base moved along."""
        c = self._predicted_gains([chosen], True, signed=False)[1][0]
        at = [*range(self.fixed), *self._columns_of(chosen)]
        return np.asarray(self.here.y + self._matrix[:, at] @ c)

    def _beyond_record(self, chosen: Sequence[int]) -> bool:
        """Whether an item of a set is a larger force than any in the records.

        Another one then takes it back: the two are one undetermined direction.
        """
        c = self._predicted_gains([chosen], True, signed=False)[1][0]
        at = self.fixed
        for g in chosen:
            columns = self.items[g].column.force
            force = sum(v * f for v, f in zip(c[at:], columns, strict=False))
            at += len(self.items[g].at)
            if columns and float(np.linalg.norm(force)) > self.here.largest_force:
                return True
        return False

    @cached_property
    def _matrix(self) -> FloatArray:
        """All columns."""
        return np.concatenate(self._blocks, axis=1)

    def least_squares(self, most: int) -> float:
        """Squared residual that forward selection leaves, in the units of the view."""
        left = self._residual_of(self.forward_selection(most))
        return float(left @ left) * float(np.mean(self.here.scale)) ** -2

    def _least_left(self, sets: Sequence[list[int]]) -> list[int]:
        """The set of items that leaves least."""
        return min(
            sets, key=lambda some: float(np.linalg.norm(self._residual_of(some))), default=[]
        )

    def squares_left(self, reversals: bool = False) -> dict[str, float]:
        """Squared residual that the best shape of each effect leaves, the base moved along.

        In the units of the view, such as N^2; "": of the base alone.  `reversals`: beside
        friction that builds up after reversals.
        """
        unit = float(np.mean(self.here.scale)) ** -2
        beside = self._least_left([[g] for g, i in enumerate(self.items) if i.name == REVERSAL])
        beside = beside if reversals else []
        left = self._residual_of(beside)
        found = {"": unit * float(left @ left)}
        for g, one in enumerate(self.items):
            left = self._residual_of([*beside, g] if g not in beside else beside)
            found[one.name] = min(found.get(one.name, math.inf), unit * float(left @ left))
        return found

    def least_left_by_law(self) -> float:
        """The least of these but for effects whose law may have any shape."""
        left = self.squares_left().items()
        lawful = (n in ("", REVERSAL) or not effect_class(n).any_shape for n, _ in left)
        return min(size for (_, size), law in zip(left, lawful, strict=True) if law)

    def item_of_any_shape(self, most: float) -> int | None:
        """The effect whose law may have any shape, if that leaves less squares than `most`.

        In the units of `squares_left`; none that is a larger force than any in the records.
        """
        unit = float(np.mean(self.here.scale)) ** -2
        left = {
            g: unit * float(np.sum(self._residual_of([g]) ** 2))
            for g, one in enumerate(self.items)
            if one.name != REVERSAL and effect_class(one.name).any_shape
        }
        best = min(left, key=left.__getitem__, default=None)
        if best is None or left[best] >= most or self._beyond_record([best]):
            return None
        return best

    def forward_selection(self, most: int, without: Collection[str] = ()) -> list[int]:
        """Items that join one after the other, those of friction after reversals among them.

        `without`: effects that stay out.
        Each joins if it gains more than by chance, by the number of independent samples of what it
        leaves: before, what is missing correlates them all.
        """
        one = copy.copy(self)
        one.g, chosen, barred = self.g.copy(), list[int](), {*without}
        left = one._residual_of(chosen)
        while len(chosen) < most:
            g = one._best_item(chosen, (REVERSAL,), barred)[1]
            if g < 0:
                break
            new = one._residual_of([*chosen, g])
            if one._beyond_record([*chosen, g]):
                barred.add(one.items[g].name)
                continue
            count = self.here.effective_sample_size(new)
            if (
                one.most[one.items[g].at[0]] < math.inf
                and count < _MIN_INDEPENDENCE_RATIO * one.count
            ):
                # It mutes the drive and its noise: what is left has more structure than before.
                barred.add(one.items[g].name)
                continue
            fall = float(new @ new) / max(float(left @ left), 1e-300)
            gain = -0.5 * count * math.log(max(fall, 1e-300))
            if gain < one._chance(g) + len(one.items[g].at) or fall > self.here.least_fall:
                break
            chosen = one._exchange_items([*chosen, g], barred)
            left = one._residual_of(chosen)
            one._count_independent(left)
        return chosen

    def _exchange_items(self, chosen: list[int], barred: Collection[str]) -> list[int]:
        """The set with each item replaced by what gains more in its place, or with fewer columns.

        What stood in for an effect that has joined since may need no more than one of them.
        """
        now = self.gains([chosen])[0]
        for k in range(len(chosen) - 1):
            gain, g = self._best_item([*chosen[:k], *chosen[k + 1 :]], (REVERSAL,), barred)
            fewer = g >= 0 and len(self.items[g].at) < len(self.items[chosen[k]].at)
            if gain > now + (-0.5 * MIN_EXCHANGE_GAIN if fewer else MIN_EXCHANGE_GAIN):
                chosen = [*chosen[:k], g, *chosen[k + 1 :]]
                now = gain
        return chosen

    def _count_independent(self, left: FloatArray) -> None:
        """Count independent samples of what is left, in whose units the prior of the base is."""
        self.count = self.here.effective_sample_size(left)
        size = float(left @ left) / self.count
        ratio = size / self._unit
        self.g[np.diag_indices(self.fixed)] += (ratio - 1.0) * self._ridge
        self._ridge, self._unit = ratio * self._ridge, size

    def _assumption_cost(self, c: FloatArray) -> FloatArray:
        """Cost of the changes of base parameters as assumptions, which is not quadratic."""
        nominal = np.array([self.problem.nominal[n] for n in self.base])
        counts = [
            k
            for k, n in enumerate(self.base)
            if nominal[k] != 0.0 and n not in self.problem.tolerance
        ]
        there = self._now[counts] * (1.0 + c[..., counts]) / nominal[counts]
        return np.asarray(joint_nominal_error_cost(nominal_error_cost(there))[0])

    def input_lead_gain(self) -> float:
        """Predicted gain of a drive that acts before its time stamps, 0 if by chance."""
        late = [
            [g]
            for g, one in enumerate(self.items)
            if one.name != REVERSAL
            and effect_class(one.name).action == "delay"
            and one.column.force
        ]
        if not late:
            return 0.0
        gains, c = self._predicted_gains(late, True, signed=False)
        early = c[:, self.fixed] < 0.0
        most = float(np.where(early, gains - self.base_gain, -np.inf).max())
        return most if most > MIN_PREDICTED_GAIN else 0.0

    @cached_property
    def base_gain(self) -> float:
        """Predicted gain of the free parameters by themselves."""
        return self.gains([[]])[0]

    def _best_item(
        self, chosen: Sequence[int], also: Sequence[str] = (), barred: Collection[str] = ()
    ) -> tuple[float, int]:
        """The effect's item with the largest gain beside chosen ones, or one of `also`."""
        names = {self.items[g].name for g in chosen}
        # Two that build friction up after a reversal do not add up: one gives way to the other.
        builds_up = any(_builds_up(n) for n in names)
        actions = excluded_actions(effect_class(n) for n in names - {REVERSAL})
        some = [
            g
            for g, one in enumerate(self.items)
            if (one.name not in names or self._is_another(one, chosen))
            and one.name not in barred
            and not (builds_up and _builds_up(one.name))
            and (
                one.name in also
                or (one.name != REVERSAL and effect_class(one.name).action not in actions)
            )
        ]
        gains = self.gains([[*chosen, g] for g in some])
        top = max(gains, default=-math.inf)
        # Of equals the one with the fewest columns.
        rows = [
            (gain, g)
            for gain, g in zip(gains, some, strict=True)
            if gain > top - 0.5 * MIN_EXCHANGE_GAIN
        ]

        def rank(row: tuple[float, int]) -> tuple[int, float]:
            gain, g = row
            return len(self.items[g].at), -gain

        return min(rows, key=rank, default=(-math.inf, -1))

    def _is_another(self, one: Item, chosen: Sequence[int]) -> bool:
        """Whether an item of a kind that a set has is another one, not a better shape of it."""
        if not one.repeats:
            return False
        records = [m.record for m in self.problem.motions]
        alike = (self.items[g].example for g in chosen if self.items[g].name == one.name)
        return all(repeat_apart(one.example, other, records) for other in alike)

    def _names_of(self, chosen: Sequence[int]) -> tuple[str, ...]:
        """Names of the effects of a set in the axis: another one of a kind is its next."""
        found = list[str]()
        for g in chosen:
            found.append(next_of_kind(self.items[g].name, found))
        return tuple(found)

    @cached_property
    def _best_shapes(self) -> dict[_Form, tuple[float, int]]:
        """Best shape of each form of an effect alone, with its predicted gain."""
        found = dict[_Form, tuple[float, int]]()
        gains = self.gains([[g] for g in range(len(self.items))])
        for g, (one, gain) in enumerate(zip(self.items, gains, strict=True)):
            if one.name == REVERSAL:
                continue
            gain = max(gain - self.base_gain, one.gain)
            key = one.name, one.form
            found[key] = max(found.get(key, (-math.inf, g)), (gain, g))
        return found

    @cached_property
    def after_reversal(self) -> int:
        """Place at which friction after reversals joins the model; MAX_CAUSES if it does not."""
        names = [self.items[g].name for g in self.forward_selection(MAX_JOINED_CAUSES)]
        return names.index(REVERSAL) if REVERSAL in names else MAX_CAUSES

    @property
    def single_gains(self) -> dict[str, float]:
        """Predicted gain of each effect alone, at least 0."""
        found = dict[str, float]()
        for (name, _), (gain, _) in self._best_shapes.items():
            found[name] = max(gain, found.get(name, 0.0))
        return found

    def sets(self) -> list[tuple[float, list[int]]]:
        """Items worth a fit, with their predicted gains: singles, and sets by selection."""
        rows = sorted(self._best_shapes.values(), reverse=True)
        # A shape with a memory that is far less likely in a pass than another one is none.
        most = max((gain for gain, g in rows if self.items[g].gain > -math.inf), default=0.0)
        least = _MIN_GAIN_FRACTION * most
        likely = [
            (gain, [g])
            for gain, g in rows
            if gain > max(self._chance(g), least * (self.items[g].gain > -math.inf))
        ]
        found = likely[:MAX_SINGLE_PROPOSALS]
        chosen: list[int] = []
        now = self.base_gain
        while len(chosen) < MAX_JOINED_CAUSES:
            gain, g = self._best_item(chosen)
            if g < 0 or gain < now + self._chance(g):
                break
            chosen = [*chosen, g]
            now = gain
            for k in range(len(chosen)):
                gain, g = self._best_item(chosen[:k] + chosen[k + 1 :])
                if gain > now + MIN_EXCHANGE_GAIN:
                    chosen = [*chosen[:k], g, *chosen[k + 1 :]]
                    now = gain
            if len(chosen) > 1:
                found.append((now - self.base_gain, list(chosen)))
        return found

    def _chance(self, g: int) -> float:
        return MIN_PREDICTED_GAIN + self.odds[self.items[g].name]

    def merges(
        self, causes: Sequence[str]
    ) -> Iterator[tuple[tuple[str, ...], str, FrictionAxis, tuple[str, ...]]]:
        """Causes and pairs of them, with the simplest effect that acts as they do in sliding.

        It has fewer parameters, of which each effect counts as one.  With its name come an axis
        with it in their place and the free parameters of that.
        """
        here, problem, slides = self.here, self.problem, self.here.direction != 0.0

        def force_of(*names: str) -> FloatArray:
            axis = problem.remove_effects(here.axis, *names)
            return -difference(axis, cast(View, here))[slides]

        alone = {n: force_of(n) for n in causes}
        there = [n for n in causes if np.any(alone[n])]
        sets = [(n,) for n in there] + [*itertools.combinations(there, 2)]
        if not sets:
            return
        force = np.stack([force_of(*some) for some in sets], axis=1)

        def rest(k: int, name: str) -> float:
            others = [alone[n] for n in sets[k] if n != name]
            columns = np.column_stack([force[:, :0], *others])
            return float(_left(columns, force[:, [k]])[1][0])

        # One that leaves as much of the force as these without one of them is no better than that.
        least = [min(rest(k, n) for n in some) for k, some in enumerate(sets)]
        most = [MAX_SAME_RESIDUAL**2 * one for one in least]
        sizes = [sum(map(_size, some)) for some in sets]
        best = self._simplest_alike(sets, sizes, force, most)
        free = problem.free_of(self.fit)
        for some, (*_, name, values) in zip(sets, best, strict=True):
            if name:
                bare = problem.remove_effects(self.fit.axis, *some)
                others = problem.free_without(free, *some)
                start = with_effect(bare, name, values)
                yield some, name, start.axis, (*others, *start.free)

    def _simplest_alike(
        self,
        sets: Sequence[tuple[str, ...]],
        sizes: Sequence[int],
        force: FloatArray,
        most: Sequence[float],
    ) -> list[tuple[float, float, str, dict[str, float]]]:
        """For each set of causes the smallest effect that acts as they do in sliding.

        Its size, the squares it leaves of their `force`, at most `most`, its name, empty if there
        is none, and its values.
        """
        slides = self.here.direction != 0.0
        best = [(math.inf, math.inf, "", dict[str, float]())] * len(sets)
        for one in (i for i in self.items if i.column.force and i.name != REVERSAL):
            c, left = _left(np.stack(one.column.force, axis=1)[slides], force)
            size = _size(one.name)
            for k, some in enumerate(sets):
                new = effect_class(one.name) not in map(effect_class, some) and size < sizes[k]
                allowed = not (one.column.positive and c[0, k] <= 0.0)
                if new and allowed and left[k] < most[k] and (size, left[k]) < best[k][:2]:
                    values = dict(one.column.values(c[:, k].tolist()))
                    best[k] = size, float(left[k]), one.name, values
        return best

    def forces_shown(self, most: int, by_drive: bool = True) -> tuple[list[int], bool]:
        """Items of forces that forward selection finds, and whether friction after reversals joins.

        `by_drive`: also what is made of the drive.
        """
        of_drive = {one.name for one in self.items if one.is_made_of_drive}
        every = self.forward_selection(most, () if by_drive else of_drive)
        forces = [g for g in every if self.items[g].name != REVERSAL]
        return forces, len(forces) < len(every)

    def starts(self, chosen: list[int]) -> list[Proposal]:
        """Starts of fits with a set of items."""
        return self._starts(self.gains([chosen])[0], chosen) if chosen else []

    def first_line(self, chosen: Sequence[int]) -> tuple[Start, tuple[str, ...]] | None:
        """The model with items of a set up to the first that repeats, and their names."""
        last = next((k for k, g in enumerate(chosen) if self.items[g].repeats), None)
        if last is None:
            return None
        some = [*chosen[: last + 1]]
        found = next(self._axes(some), None)
        if found is None:
            return None
        axis, free = found
        return Start(axis, (*self.problem.free_of(self.fit), *free)), self._names_of(some)

    def proposals(self) -> list[Proposal]:
        """Starts of fits that it has not proposed yet, with the likeliest shapes in a pass."""
        gains: list[float] = []
        sets: list[list[int]] = []
        new: set[frozenset[_Form]] = set()
        for gain, some in self.sets():
            every = frozenset(
                (name, self.items[g].form)
                for name, g in zip(self._names_of(some), some, strict=True)
            )
            if every in self._proposed:
                continue
            new.add(every)
            gains.append(gain)
            sets.append(some)
        self._proposed.update(new)
        starts = self.problem.parallel(self._starts, gains, sets)
        return [*itertools.chain(*starts), *self._instead_of_base()]

    def _instead_of_base(self) -> list[Proposal]:
        """Effects that do the same as a change of the base, which brings that nearer to nominal.

        The column of such an effect lies in the span of the base's, so that its amount is open:
        it is that with which the base is least surprising.
        """
        found: dict[str, Proposal] = {}
        count = len(self.base)
        likelihood = self.likelihood
        level = profiled_cost(likelihood, likelihood.at(self.z)) + likelihood.prior(self.z)
        for one in self.items:
            if len(one.at) != 1 or not count or one.gain > -math.inf or one.name == REVERSAL:
                continue
            j = one.at[0]
            same = np.linalg.solve(
                self.g[:count, :count] + _RIDGE * np.eye(count), self.g[:count, j]
            )
            if self.g[j, j] - self.g[:count, j] @ same > MAX_SAME_RESIDUAL**2:
                continue
            rates = same / self.scale[:count] * self.scale[j]
            most = min(one.column.most, 1.0 / max(float(np.abs(rates).max()), 1e-300))
            amounts = np.linspace(0.0 if one.column.positive else -most, most, 201)
            costs = self._assumption_cost(-amounts[:, None] * rates)
            best = int(np.argmin(costs))
            gain = float(self._assumption_cost(np.zeros(count)) - costs[best])
            if gain < MIN_PREDICTED_GAIN or gain <= getattr(found.get(one.name), "predicted", 0.0):
                continue
            c = float(amounts[best])
            try:
                start = with_effect(self.fit.axis, one.name, dict(one.column.values([c])))
            except ValueError:
                continue
            axis = with_values(start.axis, self.base, self._change_base(start.axis, -c * rates))
            cost = level - gain - self._fit_levels[0]
            found[one.name] = Proposal((one.name,), axis, start.free, cost, gain)
        return list(found.values())

    def _starts(self, predicted: float, chosen: list[int]) -> list[Proposal]:
        """The likeliest start in one pass, and that of each form with parameters of its own."""
        best = dict[tuple[tuple[str, ...], float], Proposal]()
        held = next(self._axes(chosen), (None, ()))[0]
        for option in self._neighbours(chosen):
            for one in self._one_pass(predicted, option, held):
                key = one.free, one.quieter
                if key not in best or one.cost < best[key].cost:
                    best[key] = one
        return [*best.values()]

    def _neighbours(self, chosen: list[int]) -> list[list[int]]:
        """The set, and sets with another shape of one of its effects, likeliest first."""
        options = [chosen]
        for k, g in enumerate(chosen):
            others = [
                o
                for o, one in enumerate(self.items)
                if one.name == self.items[g].name and o not in chosen
            ]
            if self.items[g].gain > -math.inf:
                continue  # its neighbours have been simulated, too
            gains = self.gains([[*chosen[:k], o, *chosen[k + 1 :]] for o in others])
            rows = [(max(n, self.items[o].gain), o) for n, o in zip(gains, others, strict=True)]
            rows = sorted((r for r in rows if r[0] > -math.inf), reverse=True)
            options += [[*chosen[:k], o, *chosen[k + 1 :]] for _, o in rows[:MAX_OTHER_SHAPES]]
        return options

    def _one_pass(
        self, predicted: float, option: Sequence[int], held: FrictionAxis | None
    ) -> Iterator[Proposal]:
        """Starts with a set of items, with their costs in one pass, where these are finite."""
        names = self._names_of(option)
        simulated = [self.items[g].gain > -math.inf for g in option]
        memory = tuple(f"{n}." for n, one in zip(names, simulated, strict=True) if one)
        usual = not any(self.items[g].form for g in option)
        starts = (
            (one, free, usual and k == 0)
            for axis, free in self._axes(option)
            for k, one in enumerate(forms(axis, names))
        )
        for axis, free, as_usual in starts:
            # The numbers of the usual form are no guide to what another one holds.
            own = free if as_usual else with_held(axis, names, free)
            try:
                every = (*self.problem.free_of(self.fit), *own)
                likelihood = self.problem.likelihood(axis, every, each=each_of(self.fit))
            except ValueError:
                continue
            remembers = tuple(n for n in own if n.startswith(memory))
            parts = self._parts if memory else SCREENING_FORCE_FACTORS[:1]
            costs = self._costs(likelihood, parts, self._fit_noises)
            for part, cost, level in zip(parts, costs, self._fit_levels, strict=False):
                cost -= level
                if math.isfinite(cost):
                    yield Proposal(names, axis, own, cost, predicted, held, remembers, part)

    def _axes(self, chosen: Sequence[int]) -> Iterator[tuple[FrictionAxis, tuple[str, ...]]]:
        """The model with items at their coefficients, its base as it is and moved along."""
        # Breakaways show the level beside all else, and the nominal one may hold the axis for good.
        moves = (True,) if self.view and self.problem.moves_in_jumps else (False, True)
        for moved in moves if self.base else (False,):
            c = self._predicted_gains([chosen], moved)[1][0]
            at = self.fixed
            axis = self.fit.axis
            free = list[str]()
            for name, g in zip(self._names_of(chosen), chosen, strict=True):
                one = self.items[g]
                values = one.column.values([float(v) for v in c[at : at + len(one.at)]])
                try:
                    start = with_effect(axis, name, dict(values))
                except ValueError as problem:
                    self.fail(name, str(problem))
                    return
                axis = start.axis
                at = at + len(one.at)
                held = [n for n in start.free if self.problem.constant(n)]
                axis = with_values(axis, held, [self.here.middle] * len(held))
                free += [n for n in start.free if n not in held]
            if moved:
                axis = with_values(axis, self.base, self._change_base(axis, c[: len(self.base)]))
            yield axis, tuple(free)

    @property
    def base_alone(self) -> FrictionAxis:
        """The model with its base moved along, without any item."""
        *_, (axis, _) = self._axes([])
        return axis

    def _change_base(self, axis: FrictionAxis, c: FloatArray) -> FloatArray:
        """Base parameters after relative changes, with their sign and within their bounds."""
        now = values_of(axis, self.base)
        some = {p.name: p for p in self.likelihood.parameters}
        low = np.array([some[n].low for n in self.base])
        high = np.array([some[n].high for n in self.base])
        factor = np.where(low < 0.0, 1.0 + c, np.clip(1.0 + c, *_BASE_FACTOR_LIMITS))
        rise = np.clip(now * factor, low, high)
        none = np.maximum(c, 0.0) * self.here.size / self.here.fast
        return np.where(now != 0.0, rise, none)


def _size(name: str) -> int:
    """Number of an effect's parameters, and itself."""
    return 1 + len(effect_class(name).named_parameters())


def _left(columns: FloatArray, force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients of columns that are nearest to some forces, and the squares that are left."""
    c = np.asarray(np.linalg.lstsq(columns.T @ columns, columns.T @ force, rcond=1e-12)[0])
    return c, ((force - columns @ c) ** 2).sum(axis=0)


def _changed_effects(
    name: str, effect: Effect, base: Sequence[str], view: View
) -> Iterator[Column]:
    """Other values of an effect that the nominal axis has, but for amounts that are in the base.

    Relative changes of each parameter.
    """
    now = dict(zip(type(effect).parameters(), effect.values, strict=True))
    free = type(effect).named_parameters()
    for one, value in now.items():
        if one not in free or value == 0.0 or f"{name}.{one}" in base:
            continue
        force = None
        if effect.action in ("force", "friction", "input"):
            axis = with_effect(view.axis, name, now | {one: value * (1.0 + CHANGED)}).axis
            force = difference(axis, view) / CHANGED
        if force is None or not np.any(force):
            for factor in (0.2, 0.7, 1.4, 2.0):
                yield simulated_column(**now | {one: factor * value})
            continue

        def values(c: Sequence[float], one: str = one, value: float = value) -> dict[str, float]:
            return now | {one: value * (1.0 + float(c[0]))}

        yield Column(values, (force,))


def _other_amounts(name: str, effect: Effect, view: View) -> Iterator[Column]:
    """Shapes of an effect that the nominal axis has which hold its force: other amounts of them.

    A weight on the other side is far from a change of its phase by a part.
    """
    values = dict(zip(effect.parameters(), effect.values, strict=True))
    force = effect_contribution(type(effect), values, view)
    for one in effect_class(name).columns(view):
        if len(one.force) < 2 or one.most < math.inf:
            continue
        slides = view.direction != 0.0
        now, left = _left(np.stack(one.force, axis=1)[slides], force[slides, None])
        if left[0] > NEGLIGIBLE_RATIO**2 * float(force @ force):
            continue

        def other_values(
            c: Sequence[float], one: Column = one, now: FloatArray = now[:, 0]
        ) -> dict[str, float]:
            return one.values([float(a + b) for a, b in zip(now, c, strict=True)])

        yield one._replace(values=other_values, positive=False)
