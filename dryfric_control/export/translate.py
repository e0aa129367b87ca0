"""C99 from the Python source of the compiled kernels.

The kernels are Python functions over numbers, arrays and tuples that numba compiles.
`Translator` reads the same functions and writes C: one C function for each kernel and each
set of argument types.  What is known when the code is written (the counts of an axis, its
laws, its structure, the numbers of a design) decides branches here, so that the C holds
what one object needs and nothing else.  The order of operations is that of the source.
"""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import math
import operator
import textwrap
from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np

from dryfric_control.compiled import axis_step, states
from dryfric_control.export import entries
from dryfric_control.model.effects.effect import read_by, read_by_flow
from dryfric_control.text import wrap_lines

#: Passes of one search loop at most: none is met before its own end.
MOST_PASSES = 1_000_000


class NotInC(ValueError):  # noqa: N818  (an error of what is translated)
    """A construct that has no C here."""


@dataclass(frozen=True)
class Kind:
    """Type of a value: "f", "i", "b" (numbers, truths), or one of the classes below."""

    code: str


@dataclass(frozen=True)
class Pointer(Kind):
    """Address of numbers; `known` are values that are fixed in the exported object."""

    element: str = "f"
    constant: bool = False
    known: tuple[tuple[int, float], ...] = ()
    length: int = 0  # of a local array


@dataclass(frozen=True)
class Known(Kind):
    """A number that is known; a whole one is an int."""

    value: int | float = 0


@dataclass(frozen=True)
class Table(Kind):
    """A constant array of the exported object."""

    name: str = ""
    element: str = "f"
    shape: tuple[int, ...] = ()
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class Record(Kind):
    """Several values: a named tuple, or a tuple (code "t") of f0, f1 and so on."""

    names: tuple[str, ...] = ()
    kinds: tuple[Kind, ...] = ()


@dataclass(frozen=True)
class Axis(Kind):
    """A `Plant`: the address of its numbers, its integers being known."""

    integers: tuple[int, ...] = ()
    known: tuple[tuple[int, float], ...] = ()
    name: str = ""  # of the constant array, where it is one


def is_erased(kind: Kind) -> bool:
    """Whether the type alone is the value, which then is no argument in C."""
    if isinstance(kind, Record):
        return kind.code != "t" and bool(kind.kinds) and all(map(is_erased, kind.kinds))
    return isinstance(kind, (Known, Table)) or (isinstance(kind, Axis) and kind.name != "")


F = Kind("f")
INT = Kind("i")
BOOL = Kind("b")
NOTHING = Kind("v")
_ATOM, _UNARY, _PRODUCT, _SUM, _ORDER, _EQUAL, _AND, _OR, _CHOICE = range(9, 0, -1)


@dataclass
class Value:
    """A C expression: its text, type, and value where that is known."""

    text: str
    kind: Kind
    known: Any = None
    binds: int = _ATOM
    parts: list[Value] = field(default_factory=list)  # of a tuple that is written out
    #: Variables and functions in the text; "*name" where an address is used but to read numbers.
    reads: frozenset[str] | None = None

    def in_parentheses(self, level: int) -> str:
        """The text, in parentheses where `level` binds closer."""
        return self.text if self.binds >= level else f"({self.text})"


@dataclass
class Function:
    """One kernel for one set of argument types."""

    name: str
    text: str
    returns: Kind
    used: tuple[bool, ...]
    pure: bool
    cost: Counter[str]
    known: Any = None  # what it returns, where that is known
    shifted: bool = False  # whether it takes `SHIFT`
    reads: frozenset[str] = frozenset()  # variables, and functions that it calls


KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while _Bool _Complex _Imaginary bool true false".split()
)
_BUILTIN = {
    "min": min,
    "max": max,
    "abs": math.fabs,
    "int": int,
    "float": float,
    "bool": bool,
}
_MATH = frozenset("exp expm1 sqrt sin cos tan tanh log erfc erf pow copysign atan2".split())
#: Operations: sign, what Python makes of numbers that are known, and what they count as.
_SIGNS: dict[type, tuple[str, Callable[..., Any], str]] = {
    ast.Add: ("+", operator.add, "add"),
    ast.Sub: ("-", operator.sub, "add"),
    ast.Mult: ("*", operator.mul, "multiply"),
    ast.Div: ("/", operator.truediv, "divide"),
    # Of whole numbers alone, which are not counted.
    ast.FloorDiv: ("/", operator.floordiv, ""),
    ast.Mod: ("%", operator.mod, ""),
    ast.BitAnd: ("&", operator.and_, ""),
    ast.BitOr: ("|", operator.or_, ""),
}
_COMPARE: dict[type, tuple[str, Callable[..., Any]]] = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}
#: Names in a loop over laws, or over states of effects, which is written out.
_BY_LAW = frozenset(("_law", "LAWS", "STATES"))
#: Arguments for whose value a function is written anew, where that is known.
_KNOWN = ("dt", "corner", "task", "place")

#: Module constants in single precision: a tolerance below its rounding would never be met.
SINGLE = {
    "TOLERANCE": 1e-4,
    "SHORTEST": 1e-4,
    "CLOSE": 1e-4,
    "_PIVOT": 1e-5,
}
#: And numbers in the text that are ends of a search, relative.
_SINGLE_LITERALS = {1e-14: 1e-6, 2e-14: 2e-6, 1e-15: 1e-6, 1e-12: 1e-6}


#: In single precision the kernels count time and positions from a near origin: the laws and the
#: Coulomb map, which alone know the true ones, add what this array of the caller holds.
SHIFT = "dfc_shift"


def common_kind(a: Kind, b: Kind) -> Kind:
    """Type that holds values of both."""
    if a == b:
        return a
    if isinstance(a, Known) or isinstance(b, Known):
        return common_kind(_runtime_kind(a), _runtime_kind(b))
    if {a, b} <= {F, INT, BOOL}:
        return F if F in (a, b) else INT
    match a, b:
        case Axis(), Axis() if a.integers == b.integers:
            return Axis("plant", a.integers, a.known)
        case Record(), Record() if (a.code, a.names) == (b.code, b.names):
            return Record(a.code, a.names, tuple(map(common_kind, a.kinds, b.kinds)))
        case Pointer(), Pointer() if a.element == b.element:
            return Pointer("p", a.element, a.constant or b.constant)
    raise NotInC(f"a variable is {a} and {b}")


class Translator:
    """Writes the C functions that an exported object needs.

    `laws`: name and Python source of each law and task by its address in the integers; `single`:
    numbers are `float`; `periods`: time and length after which a law repeats, by axis and number.
    """

    def __init__(
        self,
        laws: dict[int, tuple[str, Any]],
        single: bool = False,
        periods: dict[tuple[tuple[int, ...], int], tuple[float, float]] | None = None,
    ) -> None:
        self.laws = laws
        self.single = single
        self.periods = periods or {}
        self.shifts: list[tuple[str, float]] = []  # what `SHIFT` holds: "t" or "x", period
        self.rests = False  # whether a law reads the time at rest
        self.functions: dict[Any, Function] = {}
        self.records: dict[str, str] = {}
        self.names: Counter[str] = Counter()
        self.powers: set[int] = set()
        self.impure: set[str] = set()

    def number(self, value: float) -> str:
        """A floating-point number in C, exactly."""
        if math.isinf(value):
            return "(real)INFINITY" if value > 0.0 else "-(real)INFINITY"
        if not self.single:
            return repr(float(value))
        near = float(np.float32(value)) if abs(value) < 3e38 else math.copysign(3e38, value)
        if value != 0.0 and abs(near) < 1.2e-38:
            near = math.copysign(1.2e-38, value)
        return f"{np.float32(near)!s}f"

    def type(self, kind: Kind) -> str:
        """A type in C."""
        if isinstance(kind, Pointer):
            base = "real" if kind.element == "f" else "int32_t"
            return f"const {base} *" if kind.constant else f"{base} *"
        if isinstance(kind, Axis):
            return "const real *"
        if isinstance(kind, Record):
            return self._struct(kind)
        return {"f": "real", "i": "int32_t", "b": "bool", "v": "void"}[kind.code]

    def declaration(self, kind: Kind, name: str) -> str:
        """Declaration of a name."""
        base = self.type(kind)
        return f"{base}{name}" if base.endswith("*") else f"{base} {name}"

    def _struct(self, kind: Record) -> str:
        """Name of the structure that holds several values; it is declared once."""
        name = f"dfc_{_codes(kind) if kind.code == 't' else kind.code.lower()}"
        if name not in self.records:
            rows = "".join(f"    {one};\n" for one in map(self.declaration, kind.kinds, kind.names))
            self.records[name] = f"typedef struct {{\n{rows}}} {name};\n"
        return name

    def text(self) -> str:
        """All structures and functions, each before its use."""
        powers = map(_power, sorted(self.powers))
        # What was decided here leaves functions that nothing calls.
        called = {"dfc_sample", "dfc_look"}
        kept = []
        for function in reversed(self.functions.values()):
            if function.name in called and function.text:
                kept.append(function.text)
                called |= function.reads
        return "\n".join([*self.records.values(), *powers, *reversed(kept)])

    def function(self, source: Any, kinds: tuple[Kind, ...], name: str = "") -> Function:
        """C function of a kernel for arguments of these types."""
        python = getattr(source, "py_func", source)
        key = (python, kinds)
        if key not in self.functions:
            if not name:
                module = python.__module__.rpartition(".")[2].removesuffix("_step")
                name = f"dfc_{module}_{python.__name__.strip('_')}"
            self.names[name] += 1
            if self.names[name] > 1:
                name += f"_{self.names[name]}"
            made = _Body(self, python, kinds, name).translation()
            if not made.pure:
                self.impure.add(name)
            self.functions[key] = made
        return self.functions[key]


def _power(n: int) -> str:
    """C function of a whole power, in the order in which numba multiplies."""
    lines = []
    result = ""
    name = "x"
    m = n
    while m:
        if m & 1:
            result = f"{result} * {name}" if result else name
        m >>= 1
        if m:
            lines.append(f"    const real {name}{name[0]} = {name} * {name};\n")
            name += name[0]
    body = "".join(lines)
    return f"static real dfc_power{n}(real x)\n{{\n{body}    return {result};\n}}\n"


class _Body:
    """The body of one function while it is written."""

    def __init__(
        self,
        out: Translator,
        python: Any,
        kinds: tuple[Kind, ...],
        name: str,
    ) -> None:
        self.out = out
        self.python = python
        self.name = name
        self.node = node = self.node_of(python)
        self.parameters = [a.arg for a in node.args.args]
        self.kinds = dict(zip(self.parameters, kinds, strict=True))
        self.vars: dict[str, Kind] = dict(self.kinds)
        self.returns: Kind | None = None
        self.read: set[str] = set()
        self.dead: set[str] = set()
        closure = inspect.getclosurevars(python).nonlocals
        self.globals = {**python.__globals__, **closure}
        stored = Counter(self.parameters)
        counted = Counter[str]()
        for n in ast.walk(node):
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store):
                stored[n.id] += 1
            elif isinstance(n, ast.AugAssign):  # its target is stored once more
                stored[_base(n.target)] += 1
            elif isinstance(n, ast.For):
                counted[_base(n.target)] += 1
        self.assigned = {n for n, count in stored.items() if count > counted[n]}
        self.once = {n for n, count in stored.items() if count == 1}
        self.inside = _block_variables(node)

    @staticmethod
    def node_of(python: Any) -> ast.FunctionDef:
        """Python source of a function."""
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(python)))
        except (OSError, TypeError, SyntaxError) as problem:
            raise NotInC(f"its Python source cannot be read ({problem})") from None
        node = next(
            (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)),
            None,
        )
        if node is None:
            raise NotInC("its Python source is no plain function")
        return node

    def _reset(self) -> None:
        """Forget a pass over the function, but for types and unread variables."""
        self.lines: list[str] = []
        self.reading: set[str] = set()  # by the expression at work
        self.read = set()  # by the lines
        self.bound: dict[str, Value] = {}
        self.declared: set[str] = set()
        self.late: dict[str, Kind] = {}
        self.returned: list[Any] = []
        self.temporaries = 0
        self.depth = 0
        self.unrolling = 0
        self.pure = True
        for name, kind in self.kinds.items():
            if is_erased(kind) and name in self.once:
                self.bound[name] = self.type_value(kind)
        self.cost: Counter[str] = Counter()

    def _parameter_list(self, used: tuple[bool, ...], shifted: bool) -> str:
        """Parameters of the C function between its parentheses."""
        parameters = [f"const real *{SHIFT}"] * shifted
        for name in itertools.compress(self.parameters, used):
            parameters.append(self.out.declaration(self.parameter(name), _c_name(name)))
        return ", ".join(parameters)

    def _settle(self) -> None:
        """Translate until types and unread variables are settled."""
        before: Any = None
        for _ in range(12):
            self._reset()
            self.block(self.node.body)
            self.dead = {n for n in self.vars if n not in self.read}
            now = (dict(self.vars), self.returns, frozenset(self.dead))
            if now == before:
                break
            before = now

    def _comment_lines(self) -> list[str]:
        """Lines of a comment with the summary of the kernel."""
        doc = (ast.get_docstring(self.node) or "").split("\n\n")[0]
        comment = f"/* {' '.join(doc.split())} */" if doc else ""
        return textwrap.wrap(comment, 97, subsequent_indent="   ", break_on_hyphens=False)

    def translation(self) -> Function:
        """The function in C."""
        self._settle()
        used = tuple(n in self.read and n not in self.bound for n in self.parameters)
        returns = self.returns or NOTHING
        shifted = SHIFT in self.read
        given = self._parameter_list(used, shifted)
        if is_erased(returns):
            return Function(self.name, "", returns, used, True, self.cost)
        head = f"static {self.out.declaration(returns, self.name)}({given or 'void'})"
        self.lines[:0] = [
            f"    {self.out.declaration(kind, _c_name(n))} = {self.zero(kind)};"
            for n, kind in self.late.items()
            if n not in self.dead
        ]
        lines = [*self._comment_lines(), wrap_lines([head, "{", *self.lines, "}\n"])]
        results = set(self.returned)
        return Function(
            self.name,
            "\n".join(lines),
            returns,
            used,
            self.pure,
            self.cost,
            results.pop() if len(results) == 1 and self.pure else None,
            shifted,
            frozenset(self.read),
        )

    def parameter(self, name: str) -> Kind:
        """Type of a parameter; an address that is only read through is one of constants."""
        kind = self.kinds[name]
        if not isinstance(kind, Pointer) or kind.constant or f"*{name}" in self.read:
            return kind
        return Pointer("p", kind.element, True)

    def zero(self, kind: Kind) -> str:
        """Something to start from, never read."""
        if isinstance(kind, Record):
            return "{" + ", ".join(self.zero(k) for k in kind.kinds) + "}"
        if isinstance(kind, (Pointer, Axis)):
            return "NULL"
        return {"f": self.out.number(0.0), "i": "0", "b": "false"}[kind.code]

    def type_value(self, kind: Kind) -> Value:
        """The value that a type alone is."""
        if isinstance(kind, Known):
            return self.constant(kind.value)
        return Value(getattr(kind, "name", ""), kind)

    def error(self, node: ast.AST, why: str) -> NotInC:
        """Error that names function and line."""
        line = getattr(node, "lineno", 1)
        return NotInC(f"{self.python.__qualname__}, line {line} of it: {why}")

    # Statements -----------------------------------------------------------------------

    def emit(self, line: str, *values: Value) -> None:
        """A line of C, and the values in it that are read."""
        self.lines.append("    " * (self.depth + 1) + line)
        self.read.update(*(value.reads or () for value in values))

    def block(self, body: list[ast.stmt]) -> None:
        """Statements up to the first that ends the block."""
        self.ended = False
        for statement in body:
            method = getattr(self, f"do_{type(statement).__name__.lower()}", None)
            if method is None:
                raise self.error(statement, f"{type(statement).__name__} has no C here")
            method(statement)
            if self.ended:
                break

    def inner(self, body: list[ast.stmt]) -> Counter[str]:
        """A block in braces; what it costs at most."""
        outer = self.cost
        self.cost = Counter()
        self.depth += 1
        self.block(body)
        self.depth -= 1
        cost = self.cost
        self.cost = outer
        return cost

    def do_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return  # a docstring
        value = self.value(node.value)
        if value.kind == NOTHING:
            self.emit(f"{value.text};", value)
        else:
            self.emit_effects(value)

    def emit_effects(self, value: Value) -> None:
        """What a value that nobody reads does beside."""
        if value.reads and not self.out.impure.isdisjoint(value.reads):
            self.emit(f"(void)({value.text});", value)

    def do_pass(self, node: ast.Pass) -> None:
        self.emit(";")

    def do_return(self, node: ast.Return) -> None:
        self.ended = True
        if node.value is None:
            self.emit("return;")
            return
        value = self.value(node.value)
        self.returned.append(value.known)
        plain = _runtime_kind(value.kind)
        self.returns = plain if self.returns is None else common_kind(self.returns, plain)
        if not is_erased(self.returns):
            self.emit(f"return {self.conversion(value, self.returns)};", value)

    def do_break(self, node: ast.Break | ast.Continue) -> None:
        self.ended = True
        self.emit(f"{type(node).__name__.lower()};")

    do_continue = do_break

    def do_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.assign(node.target, self.value(node.value))

    def do_assign(self, node: ast.Assign) -> None:
        *others, last = node.targets  # a = b = value: to b first, then from it to a
        self.assign(last, self.value(node.value))
        for target in others:
            self.assign(
                target,
                self.value(ast.copy_location(_load_expression(last), node)),
            )

    def do_augassign(self, node: ast.AugAssign) -> None:
        whole = ast.BinOp(_load_expression(node.target), node.op, node.value)
        value = self.value(ast.copy_location(whole, node))
        # That a sum reads itself is no use of it.
        value.reads = (value.reads or frozenset()) - {getattr(node.target, "id", "")}
        self.assign(node.target, value)

    def assign(self, target: ast.expr, value: Value) -> None:
        """Store a value, or each of several."""
        if isinstance(target, ast.Tuple):
            self.unpack(target, value)
            return
        if isinstance(target, ast.Subscript):
            self.note_store(target)
            place = self.value(target)
            if place.kind not in (F, INT):
                raise self.error(target, "only numbers are stored in arrays")
            self.emit(
                f"{place.text} = {self.conversion(value, place.kind)};",
                place,
                value,
            )
            return
        if not isinstance(target, ast.Name):
            raise self.error(target, "this cannot be assigned to")
        self._assign_name(target.id, value)

    def _assign_name(self, name: str, value: Value) -> None:
        """Store a value in a variable."""
        held = value.parts and all(
            is_erased(p.kind) or isinstance(p.kind, Pointer) for p in value.parts
        )
        if name in self.once and (value.known is not None or is_erased(value.kind) or held):
            self.bound[name] = value
            return
        kind = _runtime_kind(value.kind)
        if isinstance(value.kind, Pointer) and value.kind.length and value.text == "[]":
            self.vars[name] = value.kind
            element = Kind(value.kind.element)
            self.declared.add(name)
            array = f"{self.out.declaration(element, _c_name(name))}[{value.kind.length}]"
            self.emit(f"{array} = {{{self.zero(element)}}};")
            return
        if isinstance(kind, Axis) and name not in self.once:
            kind = Axis("plant", kind.integers, kind.known)
        self.vars[name] = kind = common_kind(self.vars.get(name, kind), kind)
        if name in self.dead:
            self.emit_effects(value)
            return
        text = self.conversion(value, kind)
        self.emit(f"{self._left_side(name, kind)} = {text};", value)

    def _left_side(self, name: str, kind: Kind) -> str:
        """A variable where it is assigned: with its declaration where it is the first time."""
        left = _c_name(name)
        if name in self.declared or name in self.parameters:
            return left
        self.declared.add(name)
        if self.depth == 0 or (name in self.inside and not self.unrolling):
            fixed = name in self.once and not self.unrolling
            constant = "const " if fixed and not isinstance(kind, (Pointer, Axis)) else ""
            return constant + self.out.declaration(kind, left)
        self.late[name] = kind
        return left

    def note_store(self, target: ast.Subscript) -> None:
        """Note that numbers are stored through an address."""
        self.pure = False
        if isinstance(target.value, ast.Name):
            self.read.add(f"*{target.value.id}")

    def unpack(self, target: ast.Tuple, value: Value) -> None:
        """Store several values; the right side is read before any is stored."""
        names = target.elts
        if value.parts:
            self._unpack_parts(target, list(value.parts))
            return
        if value.kind.code != "t":
            raise self.error(target, "this is no tuple")
        wanted = []
        for i, part in enumerate(_parts(value)):
            own = getattr(names[i], "id", "")
            if own != "_" and own in self.dead:
                self.vars[own] = common_kind(self.vars.get(own, part.kind), part.kind)
            elif own != "_":
                wanted.append(i)
        if not wanted:
            self.emit_effects(value)
            return
        held = _parts(self.temporary(value))
        for i in wanted:
            self.assign(names[i], held[i])

    def _unpack_parts(self, target: ast.Tuple, parts: list[Value]) -> None:
        """Store the values of a tuple that is written out."""
        names = target.elts
        if len(parts) != len(names):
            raise self.error(target, "the number of values does not fit")
        stored = {_base(n) for n in names}
        if any(not stored.isdisjoint(part.reads or ()) for part in parts[1:]):
            for i, part in enumerate(parts):
                if part.known is None and not is_erased(part.kind):
                    parts[i] = self.temporary(part)
        for name, part in zip(names, parts, strict=True):
            self.assign(name, part)

    def temporary(self, value: Value) -> Value:
        """The value in a constant of its own."""
        self.temporaries += 1
        name = f"r{self.temporaries}"
        kind = _runtime_kind(value.kind)
        constant = "" if isinstance(kind, (Pointer, Axis)) else "const "
        text = self.conversion(value, kind)
        self.emit(
            f"{constant}{self.out.declaration(kind, name)} = {text};",
            value,
        )
        return Value(name, kind)

    def do_if(self, node: ast.If) -> None:
        test = self.condition_value(self.value(node.test))
        if test.known is not None:
            self.block(node.body if test.known else node.orelse)
            return
        self.emit(f"if ({test.text}) {{", test)
        first = self.inner(node.body)
        ended = self.ended
        mark = len(self.lines)
        self.emit("} else {")
        other = self.inner(node.orelse)
        if len(self.lines) == mark + 1:
            self.lines.pop()
        self.ended = ended and self.ended
        self.emit("}")
        self.cost += first | other  # the dearer of the two, by kind

    def _range(self, node: ast.For) -> tuple[Value, Value, Value]:
        """Start, stop and step of a loop over a range."""
        call = node.iter
        if not (isinstance(call, ast.Call) and getattr(call.func, "id", "") == "range"):
            raise self.error(node, "for takes range(...) or numbers")
        given = [self.value(a) for a in call.args]
        zero = Value("0", INT, 0)
        one = Value("1", INT, 1)
        start, stop, step = (zero, given[0], one) if len(given) == 1 else (*given, one)[:3]
        if step.known is None:
            raise self.error(node, "the step of a range must be known")
        return start, stop, step

    def do_for(self, node: ast.For) -> None:
        if isinstance(node.iter, ast.Tuple):
            self._unroll(node, [self.value(e).known for e in node.iter.elts])
            return
        start, stop, step = self._range(node)
        known = (start.known, stop.known, step.known)
        turns = None if None in known else range(*known)
        if turns is not None and (not turns or _BY_LAW & _names(node.body).keys()):
            self._unroll(node, list(turns))
            return
        if not isinstance(node.target, ast.Name):
            raise self.error(node, "a loop counts one variable")
        name = node.target.id
        if name == "_" or name in self.dead:
            self.temporaries += 1
            name = f"n{self.temporaries}"
        self.vars[node.target.id] = INT
        self.declared.add(node.target.id)
        own = name not in self.assigned
        if not own:
            self.late[name] = INT
        c, (sign, by), size = (
            _c_name(name),
            "<+" if step.known > 0 else ">-",
            abs(step.known),
        )
        move = f"{by}{by}{c}" if size == 1 else f"{c} {by}= {size}"
        first = f"{'int32_t ' if own else ''}{c} = {start.text}"
        self.emit(
            f"for ({first}; {c} {sign} {stop.in_parentheses(_ORDER)}; {move}) {{",
            start,
            stop,
        )
        self.read.add(name)
        self._loop(node.body, 8 if turns is None else len(turns))

    def _loop(self, body: list[ast.stmt], passes: int = 1) -> None:
        self.cost += Counter({what: passes * n for what, n in self.inner(body).items()})
        self.ended = False
        self.emit("}")

    def _unroll(self, node: ast.For, turns: list[Any]) -> None:
        """The body once for every value."""
        if not isinstance(node.target, ast.Name) or None in turns:
            raise self.error(node, "what a loop counts must be known")
        if any(isinstance(n, (ast.Break, ast.Continue)) for n in ast.walk(node)):
            raise self.error(node, "break and continue in a loop over laws")
        self.unrolling += 1
        for i in turns:
            self.bound[node.target.id] = Value(str(i), INT, i)
            self.block(node.body)
        self.bound.pop(node.target.id, None)
        self.unrolling -= 1

    def do_while(self, node: ast.While) -> None:
        self.temporaries += 1
        n = f"n{self.temporaries}"
        test = self.condition_value(self.value(node.test))
        self.emit(
            f"for (int32_t {n} = 0; ({n} < {MOST_PASSES}) && ({test.text}); ++{n}) {{",
            test,
        )
        self._loop(node.body)

    # Expressions ----------------------------------------------------------------------

    def conversion(self, value: Value, kind: Kind) -> str:
        """The text of a value as another type."""
        if isinstance(kind, Record) and (value.parts or kind != value.kind):
            parts = value.parts or _parts(self.temporary(value))
            inner = ", ".join(map(self.conversion, parts, kind.kinds))
            return f"({self.out.type(kind)}){{{inner}}}"
        if kind == F and value.kind == INT:
            if value.known is not None:
                return self.out.number(float(value.known))
            return f"(real){value.in_parentheses(_UNARY)}"
        if kind == F and value.kind == BOOL:
            one = self.out.number(1.0)
            zero = self.out.number(0.0)
            return f"({value.in_parentheses(_CHOICE + 1)} ? {one} : {zero})"
        same = kind == value.kind or (kind == INT and value.kind == BOOL)
        if same or isinstance(kind, (Pointer, Axis)):
            return value.text
        raise NotInC(f"{value.text!r} is {value.kind}, wanted {kind}")

    def condition_value(self, value: Value) -> Value:
        """The value as a condition."""
        if value.known is not None:
            return self.constant(bool(value.known))
        if value.kind == BOOL:
            return value
        zero = self.out.number(0.0) if value.kind == F else "0"
        text = f"{value.in_parentheses(_EQUAL)} != {zero}"
        return Value(text, BOOL, binds=_EQUAL, reads=value.reads)

    def value(self, node: ast.expr) -> Value:
        """C of an expression."""
        method = getattr(self, f"of_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.error(node, f"{type(node).__name__} has no C here")
        outer = self.reading
        self.reading = set()
        result: Value = method(node)
        if result.reads is None:
            decided = result.known is not None and result.kind in (
                INT,
                BOOL,
            )
            result.reads = frozenset(() if decided or is_erased(result.kind) else self.reading)
        self.reading = outer | result.reads
        return result

    def constant(self, value: Any, node: ast.expr | None = None, name: str = "") -> Value:
        """A Python value as a C one."""
        if isinstance(value, (bool, np.bool_)):
            return Value("true" if value else "false", BOOL, bool(value))
        if isinstance(value, (int, np.integer)):
            note = f" /*{name}*/" if name else ""
            return Value(
                f"{value}{note}" if value >= 0 else f"({value})",
                INT,
                int(value),
            )
        if isinstance(value, (float, np.floating)):
            number = float(value)
            if self.out.single:
                number = SINGLE.get(name, _SINGLE_LITERALS.get(number, number))
            text = self.out.number(number)
            binds = _ATOM if not text.startswith("-") else _UNARY
            return Value(text, F, number, binds, reads=frozenset())
        if isinstance(value, tuple):
            return _tuple_value([self.constant(v, node) for v in value])
        raise self.error(node or self.node, f"{value!r} has no C")

    def of_constant(self, node: ast.Constant) -> Value:
        return self.constant(node.value, node)

    def of_name(self, node: ast.Name) -> Value:
        if node.id in self.bound:
            return self.bound[node.id]
        if node.id in self.vars:
            kind = self.vars[node.id]
            reads = {node.id, f"*{node.id}"} if isinstance(kind, Pointer) else {node.id}
            return Value(_c_name(node.id), kind, reads=frozenset(reads))
        if node.id in self.globals:
            return self.constant(self.globals[node.id], node, node.id)
        raise self.error(node, f"{node.id} is unknown")

    def python_object(self, node: ast.expr) -> Any:
        """What a name or a module's name stands for in Python, None for a variable."""
        if isinstance(node, ast.Name):
            if node.id in self.vars or node.id in self.bound:
                return None
            return self.globals.get(node.id, _BUILTIN.get(node.id))
        if isinstance(node, ast.Attribute):
            owner = self.python_object(node.value)
            if isinstance(owner, ModuleType):
                return getattr(owner, node.attr, None)
        return None

    def of_attribute(self, node: ast.Attribute) -> Value:
        known = self.python_object(node)
        if known is not None:
            return self.constant(known, node, node.attr)
        owner = self.value(node.value)
        kind = owner.kind
        if isinstance(kind, Axis):
            if node.attr == "integers":
                return Value("", Table("k", "", "i", (), kind.integers))
            return Value(owner.text, Pointer("p", "f", True, kind.known))
        if isinstance(kind, Record):
            place = kind.names.index(node.attr)
            inner = kind.kinds[place]
            if is_erased(inner):
                return self.type_value(inner)
            return Value(f"{owner.text}.{node.attr}", inner)
        if isinstance(kind, Table) and node.attr == "shape":
            return self.constant(kind.shape, node)
        raise self.error(node, f"attribute {node.attr}")

    def of_subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.slice, ast.Slice):
            owner = self.value(node.value)
            if node.slice.lower is None or node.slice.upper is not None or node.slice.step:
                raise self.error(node, "only array[n:]")
            return _pointer_offset(owner, self.value(node.slice.lower), owner.kind)
        owner = self.value(node.value)
        place = self.value(node.slice)
        kind = owner.kind
        if kind.code == "t":
            parts = _parts(owner)
            if place.known is not None:
                return parts[place.known]
            inner = ", ".join(self.conversion(p, F) for p in parts)
            return Value(f"((const real[]){{{inner}}})[{place.text}]", F)
        if isinstance(kind, Table):
            return self._table_entry(node, kind, place)
        if isinstance(kind, Pointer):
            known = dict(kind.known).get(place.known)
            reads = {n for n in owner.reads or () if n[0] != "*"}.union(place.reads or ())
            text = f"{owner.in_parentheses(_ATOM)}[{place.text}]"
            return Value(text, Kind(kind.element), known, reads=frozenset(reads))
        raise self.error(node, f"{owner.text} cannot be indexed")

    def _table_entry(self, node: ast.Subscript, table: Table, place: Value) -> Value:
        """A number of a constant array."""
        known = None if place.known is None else table.values[place.known]
        if table.element == "i" and known is not None:
            return Value(str(int(known)), INT, int(known))
        if not table.name:
            raise self.error(node, "an integer of the axis at an unknown place")
        return Value(f"{table.name}[{place.text}]", Kind(table.element), known)

    def of_tuple(self, node: ast.Tuple) -> Value:
        parts: list[Value] = []
        for element in node.elts:
            if isinstance(element, ast.Starred):
                inner = self.value(element.value)
                if not inner.parts:
                    raise self.error(node, "only constants are starred")
                parts += inner.parts
            else:
                parts.append(self.value(element))
        return _tuple_value(parts)

    def of_unaryop(self, node: ast.UnaryOp) -> Value:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            test = self.condition_value(value)
            if test.known is not None:
                return self.constant(not test.known)
            return Value(f"!{test.in_parentheses(_UNARY)}", BOOL, binds=_UNARY)
        if not isinstance(node.op, ast.USub):
            raise self.error(node, "this sign")
        known = None if value.known is None else -value.known
        if value.kind == INT and known is not None:
            return self.constant(known, node)
        return Value(f"-{value.in_parentheses(_ATOM)}", value.kind, known, _UNARY)

    def of_binop(self, node: ast.BinOp) -> Value:
        op = type(node.op)
        a = self.value(node.left)
        b = self.value(node.right)
        if op is ast.Pow:
            return self.power(node, a, b)
        whole = a.kind == INT and b.kind == INT
        if op not in _SIGNS:
            raise self.error(node, f"{op.__name__} has no C here")
        sign, fold, group = _SIGNS[op]
        if whole and a.known is not None and b.known is not None and op is not ast.Div:
            return self.constant(fold(a.known, b.known), node)
        if not group:
            if not whole:
                raise self.error(node, f"{op.__name__} of numbers that are not whole")
            return Value(
                f"({a.in_parentheses(_UNARY)} {sign} {b.in_parentheses(_UNARY)})",
                INT,
            )
        level = _SUM if op in (ast.Add, ast.Sub) else _PRODUCT
        if not whole or op is ast.Div:
            left = self.real(a)
            right = self.real(b)
            known = _constant_result(op, left.known, right.known)
            if known is None:
                self.cost[group] += 1
            kind = F
        else:
            left = a
            right = b
            kind = INT
            known = None
        text = f"{left.in_parentheses(level)} {sign} {right.in_parentheses(level + 1)}"
        return Value(text, kind, known, level)

    def real(self, value: Value) -> Value:
        """The value as a floating-point number."""
        if value.kind == F:
            return value
        text = self.conversion(value, F)
        known = None if value.known is None else float(value.known)
        binds = _UNARY if text.startswith("(real)") else _ATOM
        return Value(text, F, known, binds, reads=value.reads)

    def power(self, node: ast.BinOp, a: Value, b: Value) -> Value:
        if b.kind == INT and b.known is not None and b.known > 1:
            self.cost["multiply"] += max(int(b.known).bit_length() - 1, 1)
            if a.known is not None and a.kind == INT:
                return self.constant(a.known**b.known, node)
            self.out.powers.add(b.known)
            return Value(f"dfc_power{b.known}({self.real(a).text})", F)
        self.cost["function"] += 1
        name = "powf" if self.out.single else "pow"
        return Value(f"{name}({self.real(a).text}, {self.real(b).text})", F)

    def of_boolop(self, node: ast.BoolOp) -> Value:
        is_and = isinstance(node.op, ast.And)
        parts: list[Value] = []
        for element in node.values:
            part = self.condition_value(self.value(element))
            if part.known != is_and:
                parts.append(part)
            if part.known == (not is_and):  # it decides
                break
        if not parts:
            return self.constant(is_and)
        if len(parts) == 1:
            return parts[0]
        level = _AND if is_and else _OR
        text = (" && " if is_and else " || ").join(p.in_parentheses(_ORDER) for p in parts)
        return Value(text, BOOL, binds=level)

    def of_compare(self, node: ast.Compare) -> Value:
        operands = [
            self.value(node.left),
            *(self.value(c) for c in node.comparators),
        ]
        parts: list[Value] = []
        for op, a, b in zip(node.ops, operands, operands[1:], strict=False):
            if type(op) not in _COMPARE:
                raise self.error(node, f"{type(op).__name__} has no C here")
            sign, fold = _COMPARE[type(op)]
            if a.known is not None and b.known is not None:
                if not fold(a.known, b.known):
                    return self.constant(False)
                continue
            if a.kind != b.kind:
                a = self.real(a)
                b = self.real(b)
            level = _EQUAL if isinstance(op, (ast.Eq, ast.NotEq)) else _ORDER
            if a.kind == F:
                self.cost["compare"] += 1
            text = f"{a.in_parentheses(_SUM)} {sign} {b.in_parentheses(_SUM)}"
            parts.append(Value(text, BOOL, binds=level))
        if not parts:
            return self.constant(True)
        if len(parts) == 1:
            return parts[0]
        return Value(" && ".join(f"({p.text})" for p in parts), BOOL, binds=_AND)

    def of_ifexp(self, node: ast.IfExp) -> Value:
        test = self.condition_value(self.value(node.test))
        if test.known is not None:
            return self.value(node.body if test.known else node.orelse)
        a = self.value(node.body)
        b = self.value(node.orelse)
        kind = common_kind(_runtime_kind(a.kind), _runtime_kind(b.kind))
        left = self.conversion(a, kind)
        right = self.conversion(b, kind)
        left, right = (
            text if value.binds >= _UNARY or text.startswith("(real)") else f"({text})"
            for value, text in ((a, left), (b, right))
        )
        return Value(
            f"{test.in_parentheses(_ATOM)} ? {left} : {right}",
            kind,
            binds=_CHOICE,
        )

    def of_call(self, node: ast.Call) -> Value:
        target = self.python_object(node.func)
        if target is None:
            raise self.error(node, f"{ast.unparse(node.func)} cannot be called")
        special = _SPECIAL.get(target) if isinstance(target, Hashable) else None
        if special is not None:
            return special(self, node)
        if node.keywords:
            raise self.error(node, "arguments by keyword")
        if isinstance(target, type) and issubclass(target, tuple):
            return self.record(target, [self.value(a) for a in node.args])
        name = getattr(target, "__name__", "")
        if getattr(target, "__module__", "") == "math":
            return self.math(node, name)
        return self.call(target, [self.value(a) for a in node.args], node)

    def record(self, cls: type, given: list[Value]) -> Value:
        """A named tuple."""
        if cls is axis_step.Plant:
            numbers, integers = given
            assert isinstance(integers.kind, Table)
            values = tuple(map(int, integers.kind.values))
            if isinstance(numbers.kind, Table):
                known = tuple(enumerate(numbers.kind.values))
                return self.type_value(Axis("plant", values, known, numbers.kind.name))
            known = getattr(numbers.kind, "known", ())
            return Value(
                numbers.text,
                Axis("plant", values, known),
                binds=numbers.binds,
            )
        names = cls._fields  # type: ignore[attr-defined]
        kinds = tuple(
            Known("k", v.known) if v.known is not None and v.kind == INT else _runtime_kind(v.kind)
            for v in given
        )
        kind = Record(cls.__name__, names, kinds)
        if is_erased(kind):
            return Value("", kind)
        kind = Record(cls.__name__, names, tuple(map(_runtime_kind, kinds)))
        inner = ", ".join(v.text for v in given)
        return Value(f"({self.out.type(kind)}){{{inner}}}", kind)

    def math(self, node: ast.Call, name: str) -> Value:
        """A function of the C library."""
        given = [self.real(self.value(a)) for a in node.args]
        suffix = "f" if self.out.single else ""
        if name in _MATH and all(v.known is not None for v in given):
            # Here, by the library of the kernels: a compiler rounds such a constant its own way.
            return self.constant(getattr(math, name)(*(v.known for v in given)), node)
        self.cost["function"] += name != "fabs"
        text = f"{name}{suffix}({', '.join(v.text for v in given)})"
        if name in ("ceil", "floor"):
            return Value(f"(int32_t){text}", INT, binds=_UNARY)
        if name not in _MATH and name != "fabs":
            raise self.error(node, f"math.{name} has no C here")
        return Value(text, F)

    def call(
        self,
        target: Any,
        given: list[Value],
        node: ast.Call,
        name: str = "",
    ) -> Value:
        """A call of another kernel."""
        python = getattr(target, "py_func", target)
        if not inspect.isfunction(python):
            raise self.error(node, f"{ast.unparse(node.func)} has no C here")
        parameters = list(inspect.signature(python).parameters.values())
        for parameter in parameters[len(given) :]:
            given.append(self.constant(parameter.default, node))
        numbers = len(parameters) - 1 if name.startswith("dfc_law_") else 0
        kinds: list[Kind] = [F] * numbers
        for parameter, value in list(zip(parameters, given, strict=True))[numbers:]:
            kinds.append(_argument_kind(parameter.name, value))
        made = self.out.function(target, tuple(kinds), name)
        self.cost += made.cost
        self.cost["call"] += 1
        if not made.pure:
            self.pure = False
        if is_erased(made.returns):
            return self.type_value(made.returns)
        if made.known is not None:
            return self.constant(made.known, node)
        taken = list(itertools.compress(zip(given, kinds, strict=True), made.used))
        texts = [self.conversion(*one) for one in taken]
        reads = {made.name}.union(*(value.reads or () for value, _ in taken))
        if made.shifted:
            texts.insert(0, SHIFT)
            reads.add(SHIFT)
        text = f"{made.name}({', '.join(texts)})"
        return Value(text, made.returns, reads=frozenset(reads))


def _argument_kind(name: str, value: Value) -> Kind:
    """Type of an argument; one of some names is part of the type where its value is known."""
    if name in _KNOWN and value.known is not None:
        return Known("k", value.known)
    return value.kind if is_erased(value.kind) else _runtime_kind(value.kind)


def _constant_result(op: type, a: float | None, b: float | None) -> float | None:
    """Result of an operation on numbers that are known."""
    if a is None or b is None or (op is ast.Div and b == 0.0):
        return None
    result = _SIGNS[op][1](a, b)
    return float(result) if math.isfinite(result) else None


def _tuple_value(parts: list[Value]) -> Value:
    """A tuple that is written out."""
    names = tuple(f"f{i}" for i in range(len(parts)))
    return Value(
        "",
        Record("t", names, tuple(_runtime_kind(p.kind) for p in parts)),
        parts=parts,
    )


def _parts(value: Value) -> list[Value]:
    """The values of a tuple, one by one."""
    assert isinstance(value.kind, Record)
    members = zip(value.kind.names, value.kind.kinds, strict=True)
    return value.parts or [Value(f"{value.text}.{name}", kind) for name, kind in members]


def _codes(kind: Record) -> str:
    """Letters that name a tuple by what it holds."""
    inner = (
        f"t{_codes(k)}e" if isinstance(k, Record) and k.code == "t" else k.code for k in kind.kinds
    )
    return "".join(inner)


def _runtime_kind(kind: Kind) -> Kind:
    """The type without what is known of the value alone."""
    if isinstance(kind, Known):
        return INT if isinstance(kind.value, int) else F
    if isinstance(kind, Pointer) and kind.length:
        return Pointer("p", kind.element, kind.constant)
    return kind


def _c_name(name: str) -> str:
    """A Python name as a C name."""
    return f"{name}_" if name in KEYWORDS else name


def _base(node: ast.expr) -> str:
    while isinstance(node, (ast.Subscript, ast.Attribute)):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def _load_expression(node: ast.expr) -> ast.expr:
    """The target of an assignment as something to read."""
    if isinstance(node, ast.Name):
        return ast.Name(node.id, ast.Load())
    if isinstance(node, ast.Subscript):
        return ast.Subscript(node.value, node.slice, ast.Load())
    return node


def _names(nodes: list[ast.stmt]) -> Counter[str]:
    """How often each variable occurs."""
    return Counter(n.id for one in nodes for n in ast.walk(one) if isinstance(n, ast.Name))


def _block_variables(node: ast.FunctionDef) -> set[str]:
    """Variables that only one block knows, which stores them before it reads them."""
    everywhere = _names(node.body)
    found = set()
    for owner in ast.walk(node):
        for block in (
            getattr(owner, "body", None),
            getattr(owner, "orelse", None),
        ):
            if not isinstance(block, list):
                continue
            here = _names(block)
            seen = Counter[str]()
            for statement in block:
                own = _names([statement])
                if isinstance(statement, ast.Assign):
                    stored = {n.id for n in ast.walk(statement) if isinstance(n, ast.Name)}
                    first = {n for n in stored if own[n] == 1 and not seen[n]}
                    found |= {n for n in first if here[n] == everywhere[n]}
                seen += own
    return found


# What numba or Python gives the kernels, in C ------------------------------------------


def _extreme(body: _Body, node: ast.Call, kernel: Any, name: str) -> Value:
    given = [body.value(a) for a in node.args]
    if any(v.kind != INT for v in given):
        given = [body.real(v) for v in given]
    return functools.reduce(lambda a, b: body.call(kernel, [a, b], node, name), given)


def _to_int(body: _Body, node: ast.Call) -> Value:
    value = body.value(node.args[0])
    if value.known is not None:
        return body.constant(int(value.known), node)
    if value.kind == INT:
        return value
    return Value(f"(int32_t){value.in_parentheses(_UNARY)}", INT, binds=_UNARY)


def _offset_pointer(body: _Body, node: ast.Call) -> Value:
    start = body.value(node.args[0])
    count = body.value(node.args[1])
    if not isinstance(start.kind, Pointer):
        raise body.error(node, "an address of numbers")
    kind = Pointer("p", start.kind.element, start.kind.constant, start.kind.known)
    return _pointer_offset(start, count, kind)


def _pointer_offset(start: Value, count: Value, kind: Kind) -> Value:
    """An address some numbers further on."""
    return Value(
        f"{start.in_parentheses(_SUM)} + {count.in_parentheses(_SUM + 1)}",
        kind,
        binds=_SUM,
    )


def _local(body: _Body, node: ast.Call) -> Value:
    length = body.value(node.args[0]).known if node.args else axis_step.HISTORY
    if length is None:
        raise body.error(node, "the length of an array must be known")
    return Value(
        "[]",
        Pointer(
            "p",
            "i" if len(node.args) > 1 else "f",
            False,
            (),
            int(length),
        ),
    )


def _unshifted_value(body: _Body, value: Value, variable: str, period: float = math.inf) -> Value:
    """A time or position of the kernels as a law knows it, less whole periods."""
    if not body.out.single:
        return value
    if (variable, period) not in body.out.shifts:
        body.out.shifts.append((variable, period))
    place = body.out.shifts.index((variable, period))
    reads = frozenset({SHIFT, *(value.reads or ())})
    return Value(
        f"{value.in_parentheses(_SUM)} + {SHIFT}[{place}]",
        F,
        binds=_SUM,
        reads=reads,
    )


def _base_level(body: _Body, node: ast.Call) -> Value:
    plant, x, s = [body.value(a) for a in node.args]
    assert isinstance(plant.kind, Axis)
    i = plant.kind.integers
    if i[axis_step.N_PLUS] + i[axis_step.N_MINUS] > 2:
        x = _unshifted_value(body, x, "x")
    return body.call(axis_step.base_level, [plant, x, s], node)


def _law(body: _Body, node: ast.Call) -> Value:
    plant, i, *rest = [body.value(a) for a in node.args]
    assert isinstance(plant.kind, Axis)
    place = axis_step.LAWS + 2 * i.known
    address = plant.kind.integers[place]
    offset = plant.kind.integers[place + 1]
    name, law = body.out.laws[address]
    read = read_by(law)
    time, length = body.out.periods.get((plant.kind.integers, i.known), (math.inf, math.inf))
    if "t" in read:
        rest[0] = _unshifted_value(body, rest[0], "t", time)
    if "x" in read:
        rest[1] = _unshifted_value(body, rest[1], "x", length)
    body.out.rests |= "rest" in read
    text = f"{plant.in_parentheses(_SUM)} + {offset}"
    kind = Pointer("p", "f", True)
    numbers = Value(text, kind, binds=_SUM, reads=plant.reads)
    return body.call(law, [*rest, numbers], node, f"dfc_law_{name}")


def _flow(body: _Body, node: ast.Call, place: int, kind: str) -> Value:
    """Flow or jump of a state, whose row holds its address at a place."""
    plant, row, *rest = [body.value(a) for a in node.args]
    assert isinstance(plant.kind, Axis)
    integers = plant.kind.integers
    law = integers[row.known + states.LAW_OF]
    name, function = body.out.laws[integers[row.known + place]]
    read = read_by_flow(function)
    time, length = body.out.periods.get((integers, law), (math.inf, math.inf))
    rest = [body.real(value) for value in rest]
    if "t" in read:
        rest[0] = _unshifted_value(body, rest[0], "t", time)
    if "x" in read:
        rest[1] = _unshifted_value(body, rest[1], "x", length)
    body.out.rests |= "rest" in read
    number = body.constant(integers[row.known + states.NUMBER], node)
    text = f"{plant.in_parentheses(_SUM)} + {integers[axis_step.LAWS + 2 * law + 1]}"
    numbers = Value(text, Pointer("p", "f", True), binds=_SUM, reads=plant.reads)
    return body.call(function, [number, *rest, numbers], node, f"dfc_{kind}_{name}")


def _task(body: _Body, node: ast.Call) -> Value:
    address, *given = [body.value(a) for a in node.args]
    _, task = body.out.laws[address.known]
    return body.call(task, given, node)


_SPECIAL: dict[Any, Callable[[_Body, ast.Call], Value]] = {
    min: lambda body, node: _extreme(body, node, entries.minimum, "dfc_min"),
    max: lambda body, node: _extreme(body, node, entries.maximum, "dfc_max"),
    int: _to_int,
    float: lambda body, node: body.real(body.value(node.args[0])),
    axis_step.pointer: lambda body, node: body.value(node.args[0]),
    axis_step.offset_address: _offset_pointer,
    axis_step.spare_memory: _local,
    np.empty: _local,
    np.zeros: _local,
    axis_step._law: _law,
    states._flow: lambda body, node: _flow(body, node, states.FLOW_OF, "flow"),
    states._jump: lambda body, node: _flow(body, node, states.JUMP_OF, "jump"),
    axis_step.base_level: _base_level,
    axis_step._call_task: _task,
}
