"""Changes of the core, one place at a time, that no test notices (1 to 5 min a mutant).

Run ``python benchmarks/mutation.py --mutants 60``.  The tree is copied to a scratch folder; there,
one mutant at a time, a comparison, an operator, a sign, a number, a choice between the smaller and
the larger, or a whole statement of a core module is changed, and the tests that fit the module
run until the first failure.  Mutants are drawn with a seed, evenly over the targets.  Prints every
mutant with what became of it, the survivors as a list and their rate; returns 1 if any survived.
One that runs out of time may loop without end, or the machine is busy: look at it yourself.

A survivor is a gap in the tests or an equivalent: code that says the same another way, a bound
that is never met, a step that only saves time.  Compiled modules get an empty cache for every
mutant, since numba does not see a change in a function that another file calls.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Target:
    """A module, the tests that should notice, fastest first, and whether numba compiles it."""

    path: str
    tests: tuple[str, ...]
    compiled: bool = False

    def mutants(self) -> list[Mutant]:
        """Every mutant of the module."""
        return list(mutants((ROOT / self.path).read_text()))


_DIAGNOSIS = (
    "tests/diagnosis/test_linearised.py",
    "tests/diagnosis/test_noise_floor.py",
    "tests/estimation/test_held_out.py",
    "tests/diagnosis/test_candidates.py",
    "tests/diagnosis/test_several_causes.py",
    "tests/diagnosis/test_imposed.py",
    "tests/model/test_new_effect.py",
)
TARGETS = {
    "kernels": Target(
        "dryfric_control/compiled/axis_step.py",
        ("tests/model/test_axis.py", "tests/model/test_event_accuracy.py", "tests/model/test_effects.py",
         "tests/model/test_properties.py", "tests/model/test_blocks.py"),
        compiled=True,
    ),
    "inner": Target(
        "dryfric_control/compiled/elastic.py",
        ("tests/model/test_structural_effects.py", "tests/model/test_against_the_bench.py"),
        compiled=True,
    ),
    "synthesis": Target(
        "dryfric_control/observer/synthesis.py",
        ("tests/observer/test_observer_synthesis.py", "tests/observer/test_observer_certificate.py"),
    ),
    "certificate": Target(
        "dryfric_control/observer/certificate.py",
        ("tests/observer/test_observer_certificate.py", "tests/observer/test_observer_synthesis.py"),
    ),
    "tube": Target(
        "dryfric_control/compensation/certificate.py",
        ("tests/compensation/test_compensation.py", "tests/compensation/test_tube.py"),
    ),
    "columns": Target("dryfric_control/diagnosis/gram.py", _DIAGNOSIS),
    "search": Target("dryfric_control/diagnosis/search.py", _DIAGNOSIS),
    "criterion": Target("dryfric_control/diagnosis/criterion.py", _DIAGNOSIS),
    "looks": Target("dryfric_control/diagnosis/looks.py", _DIAGNOSIS),
    "floor": Target("dryfric_control/diagnosis/verdict.py", _DIAGNOSIS),
}  # fmt: skip

COMPARISONS = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}  # fmt: skip
REVERSED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
OPERATORS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.Pow: ast.Mult,
}  # fmt: skip
CALLS = {"min": "max", "max": "min", "maximum": "minimum", "minimum": "maximum"}
REMOVED = (ast.Assign, ast.AugAssign, ast.Expr, ast.If, ast.Break, ast.Continue)


@dataclass(frozen=True)
class Mutant:
    """One change: the text between two places of the source, and what takes its place."""

    line: int
    kind: str
    start: int
    end: int
    old: str
    new: str

    def __str__(self) -> str:
        old, new = (" ".join(text.split())[:70] for text in (self.old, self.new))
        return f"line {self.line}, {self.kind}: {old}  ->  {new}"


def mutants(source: str) -> Iterator[Mutant]:
    """Every change that is tried on a module, function bodies only."""
    encoded = source.encode()
    starts = [0]
    for line in encoded.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def changed(node: ast.AST, kind: str, new: str) -> Mutant:
        start = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
        end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
        return Mutant(node.lineno, kind, start, end, encoded[start:end].decode(), new)  # type: ignore[attr-defined]

    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef):
            continue
        for statement in function.body:
            for node in _inside(statement):
                for kind, new in _changes(node):
                    yield changed(node, kind, new)


def _inside(node: ast.AST) -> Iterator[ast.AST]:
    """A statement and its parts, without nested functions, texts and what only fails."""
    if isinstance(node, ast.FunctionDef | ast.Raise | ast.JoinedStr):
        return
    yield node
    for child in ast.iter_child_nodes(node):
        yield from _inside(child)


def _changes(node: ast.AST) -> Iterator[tuple[str, str]]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for table, kind in ((COMPARISONS, "edge"), (REVERSED, "direction")):
            other = table.get(type(node.ops[0]))
            if other is not None:
                yield kind, ast.unparse(ast.Compare(node.left, [other()], node.comparators))
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        swapped = ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right)
        yield "operator", f"({ast.unparse(swapped)})"
    elif isinstance(node, ast.BoolOp):
        word = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield "and/or", f"({ast.unparse(ast.BoolOp(word, node.values))})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign", f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        if isinstance(node.value, bool):
            return
        yield "number", repr(node.value + 1 if node.value in (0, 1) else 2 * node.value)
    elif isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        name = node.func.id if isinstance(node.func, ast.Name) else name
        if name == "abs" and len(node.args) == 1:
            yield "abs", f"({ast.unparse(node.args[0])})"
        if name in CALLS:
            text = ast.unparse(node.func)
            call = ast.unparse(node)
            yield "min/max", text[: -len(name)] + CALLS[name] + call[len(text) :]
    elif isinstance(node, REMOVED) and not (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ):
        yield "removed", "pass"


def drawn(count: int, seed: int, names: list[str]) -> list[tuple[str, Mutant]]:
    """Mutants of the sample, evenly over the targets."""
    rng = random.Random(seed)
    chosen = []
    for name in names:
        known = TARGETS[name].mutants()
        size = min(len(known), max(1, round(count / len(names))))
        chosen += [(name, mutant) for mutant in rng.sample(known, size)]
        print(f"{name}: {size} of {len(known)} mutants", flush=True)
    return chosen


def test(tree: Path, target: Target, cache: Path, timeout: float) -> str:
    """What the tests say: "killed", "timeout", "survived" or how they failed to run."""
    command = [sys.executable, "-m", "pytest", "-o", "addopts=", "-q", "-x", "-p",
               "no:cacheprovider", *target.tests]  # fmt: skip
    environment = os.environ | {
        "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(cache), "MPLBACKEND": "Agg",
        "PYTHONDONTWRITEBYTECODE": "1",
    }  # fmt: skip
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, timeout=timeout, capture_output=True, text=True
        )
    except subprocess.TimeoutExpired:
        return "timeout"
    if done.returncode == 0:
        return "survived"
    failed = [s for s in done.stdout.splitlines() if s.startswith(("FAILED", "ERROR"))]
    return f"killed by {failed[0].split(' - ')[0].split('::')[-1]}" if failed else "killed"


def main() -> int:
    """Draw, test, report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--mutants", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=TARGETS, default=list(TARGETS))
    parser.add_argument("--timeout", type=float, default=600.0, help="for one mutant [s]")
    parser.add_argument("--scratch", type=Path, help="keep the copy and its compiled code here")
    parser.add_argument("--unchecked", action="store_true", help="the tests are known to pass")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no mutant after this")
    arguments = parser.parse_args()
    chosen = drawn(arguments.mutants, arguments.seed, arguments.only)
    begun, told, late, survivors = time.monotonic(), 0, 0, []
    with tempfile.TemporaryDirectory() as folder:
        scratch = arguments.scratch or Path(folder)
        tree, warm = scratch / "tree", scratch / "warm"
        skip = shutil.ignore_patterns(".*", "__pycache__", "*.nb[ic]", "_build", "notebooks")
        shutil.copytree(ROOT, tree, ignore=skip, dirs_exist_ok=True)
        for name in {frozenset(TARGETS[name].tests): name for name in arguments.only}.values():
            # The tests must pass on the tree as it is, or every mutant seems killed.
            if arguments.unchecked:
                break
            said = test(tree, TARGETS[name], warm, 3.0 * arguments.timeout)
            print(f"{name} unchanged: {said}", flush=True)
            if said != "survived":
                return 2
        for number, (name, mutant) in enumerate(chosen):
            if time.monotonic() - begun > 60.0 * arguments.minutes:
                print(f"out of time: {len(chosen) - number} mutants not tried", flush=True)
                break
            target = TARGETS[name]
            file, cache = tree / target.path, scratch / f"cache{number}"
            source = file.read_bytes()
            file.write_bytes(source[: mutant.start] + mutant.new.encode() + source[mutant.end :])
            said = test(tree, target, cache if target.compiled else warm, arguments.timeout)
            file.write_bytes(source)
            shutil.rmtree(cache, ignore_errors=True)
            told += 1
            late += said == "timeout"
            print(f"{said:<50} {name} {mutant}", flush=True)
            if said == "survived":
                survivors.append(f"{name} {mutant}")
    rate = 100.0 * len(survivors) / max(told, 1)
    print(f"\nsurvivors: {len(survivors)} of {told} ({rate:.0f} %), ran out of time: {late}")
    print("\n".join(survivors))
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
