"""How densely the package is written, package by package (2 s).

Prints lines, lines of code, tokens and tokens a line of code of each package; then

- functions above a complexity of 15 and of 30 (McCabe's number, counted as radon does),
- function names of one word that no textbook or library of the field has (`field_words.toml`
  holds the words and their sources; a plural counts as its singular),
- tuple assignments of constants (``A, B = 1, 2``),
- deciding constants of `diagnosis` and of `estimation`: numbers with a name in capitals, a tuple
  of numbers once, and numbers with a fraction that are compared with inside a function; what only
  places a figure on its page does not count.

python benchmarks/lines.py [folder] [--list]

With ``--list`` the functions, names, assignments and constants themselves are printed, each with
its place.  For a package not ours, only the table of tokens compares.
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "dryfric_control"
#: Words of the field, by source.
FIELD_WORDS = Path(__file__).with_name("field_words.toml")
#: Complexities above which functions are counted.
COMPLEXITY_LEVELS = (15, 30)
#: Packages whose constants decide what a diagnosis says.
DECIDING_PACKAGES = ("diagnosis", "estimation")
#: Modules of them that draw: their numbers place a figure on its page.
DRAWING = ("diagnosis/report/figures.py", "diagnosis/report/page.py")
#: Tokens that are layout or comments.
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)


def docstring_lines(tree: ast.AST) -> set[int]:
    """Numbers of the lines that docstrings fill."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, *FUNCTION)) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                if isinstance(first.value.value, str):
                    lines.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return lines


def size(source: str) -> tuple[int, int]:
    """Lines of code and tokens of a source; docstrings and comments are neither.

    A line of code holds a name, a number or a text: brackets alone are none.  Brackets, operators
    and commas are tokens.

    Examples
    --------
    >>> size('def f(x):\\n    "Twice."\\n    # a remark\\n\\n    return 2 * x\\n')
    (2, 10)
    """
    described = docstring_lines(ast.parse(source))
    lines: set[int] = set()
    tokens = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in LAYOUT or token.start[0] in described:
            continue
        tokens += 1
        if token.type != tokenize.OP:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines), tokens


def complexity(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """McCabe's complexity of a function, as radon counts it.

    One, and one more for each branch, loop, handler, assertion, comprehension and its conditions,
    `else` of a loop or a `try`, case of a match but the wildcard, and operand of `and` or `or`
    after the first.  A function inside counts by itself, and adds nothing.

    Examples
    --------
    >>> complexity(ast.parse("def f(x):\\n    return 1 if x and x > 2 else 0").body[0])
    3
    """
    return 1 + sum(branches(statement) for statement in function.body)


def branches(node: ast.AST) -> int:
    """What a node and everything in it adds to the complexity of its function."""
    if isinstance(node, FUNCTION):
        return 0
    return own_branches(node) + sum(branches(child) for child in ast.iter_child_nodes(node))


def own_branches(node: ast.AST) -> int:
    """What a node adds by itself."""
    match node:
        case ast.If() | ast.IfExp() | ast.Assert():
            return 1
        case ast.For() | ast.AsyncFor() | ast.While():
            return 1 + bool(node.orelse)
        case ast.Try():
            return len(node.handlers) + bool(node.orelse)
        case ast.BoolOp():
            return len(node.values) - 1
        case ast.comprehension():
            return 1 + len(node.ifs)
        case ast.Match():
            wildcard = any(getattr(one.pattern, "pattern", node) is None for one in node.cases)
            return len(node.cases) - wildcard
    return 0


def field_words(path: Path = FIELD_WORDS) -> set[str]:
    """The words of all sources."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    return {word for table in tables.values() for word in table["words"].split()}


def is_field_word(word: str, words: set[str]) -> bool:
    """Whether a word, or the singular of a plural, is one of the field.

    Examples
    --------
    >>> is_field_word("velocities", {"velocity"}), is_field_word("walked", {"velocity"})
    (True, False)
    """
    singulars = [word, word.removesuffix("s"), word.removesuffix("es")]
    if word.endswith("ies"):
        singulars.append(word[:-3] + "y")
    return any(singular in words for singular in singulars)


def is_number(node: ast.AST) -> bool:
    """Whether an expression is a number, or is computed of numbers and names in capitals alone."""
    allowed = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.operator, ast.unaryop, ast.Name, ast.Load)
    parts = list(ast.walk(node))
    return (
        all(isinstance(part, allowed) for part in parts)
        and any(isinstance(part, ast.Constant) for part in parts)
        and all(
            type(part.value) in (int, float) for part in parts if isinstance(part, ast.Constant)
        )
        and all(part.id.isupper() for part in parts if isinstance(part, ast.Name))
    )


def is_numeric(node: ast.AST) -> bool:
    """Whether an expression is a number or a tuple or list of numbers."""
    if isinstance(node, (ast.Tuple, ast.List)):
        return bool(node.elts) and all(is_numeric(element) for element in node.elts)
    return is_number(node)


def tuple_assignments(tree: ast.AST) -> Iterator[ast.Assign]:
    """Assignments of several constants at once, in a function or outside."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
            value = node.value
            if isinstance(value, ast.Tuple) and all(is_numeric(one) for one in value.elts):
                yield node


def named_constants(module: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and name of each numeric constant of a module."""
    for node in module.body:
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = node.targets
        elif isinstance(node, ast.AnnAssign):
            targets = [node.target]
        value = getattr(node, "value", None)
        for target in targets:
            if value is None:
                continue
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = list(zip(target.elts, value.elts, strict=False))
            else:
                pairs = [(target, value)]
            for name, number in pairs:
                if isinstance(name, ast.Name) and name.id.isupper() and is_numeric(number):
                    yield node.lineno, name.id


def compared_numbers(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of each number with a fraction in a comparison."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            for operand in (node.left, *node.comparators):
                for part in ast.walk(operand):
                    if isinstance(part, ast.Constant) and type(part.value) is float:
                        if part.value not in (0.0, 1.0):
                            yield node.lineno, ast.unparse(node)


@dataclass
class Counts:
    """What is counted of a package: sizes by package, and findings, each with its place."""

    lines: dict[str, int]
    code: dict[str, int]
    tokens: dict[str, int]
    complexities: list[tuple[int, str]]
    functions: int
    single_words: int
    unknown_names: list[str]
    tuples: list[str]
    constants: dict[str, list[str]]


def counts(package: Path) -> Counts:
    """Count a package."""
    words = field_words()
    result = Counts({}, {}, {}, [], 0, 0, [], [], {name: [] for name in DECIDING_PACKAGES})
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).parts
        inner = parts[0] if len(parts) > 1 else "(top)"
        source = path.read_text(encoding="utf-8")
        tree = ast.parse(source)
        code, tokens = size(source)
        result.lines[inner] = result.lines.get(inner, 0) + source.count("\n")
        result.code[inner] = result.code.get(inner, 0) + code
        result.tokens[inner] = result.tokens.get(inner, 0) + tokens
        place = "/".join(parts)
        _count_functions(result, tree, place, words)
        result.tuples += [f"{place}:{node.lineno}" for node in tuple_assignments(tree)]
        if inner in DECIDING_PACKAGES and place not in DRAWING:
            numbers = [*named_constants(tree), *compared_numbers(tree)]
            result.constants[inner] += [f"{place}:{line}: {text}" for line, text in numbers]
    return result


def _count_functions(result: Counts, tree: ast.AST, place: str, words: set[str]) -> None:
    """Add complexities and names of a module's functions; those of Python itself have no name."""
    for node in ast.walk(tree):
        if not isinstance(node, FUNCTION):
            continue
        result.complexities.append((complexity(node), f"{place}:{node.lineno}: {node.name}"))
        name = node.name.strip("_")
        if node.name.startswith("__"):
            continue
        result.functions += 1
        if "_" not in name:
            result.single_words += 1
            if not is_field_word(name, words):
                result.unknown_names.append(f"{place}:{node.lineno}: {name}")


def _print_rows(result: Counts) -> None:
    print(f"{'package':16}{'lines':>8}{'code':>8}{'tokens':>9}{'tokens/line':>13}")
    rows = [(name, result.lines[name], result.code[name], result.tokens[name])
            for name in sorted(result.lines)]  # fmt: skip
    rows.append(("all", *(sum(column) for column in list(zip(*rows, strict=True))[1:])))
    for name, lines, code, tokens in rows:
        print(f"{name:16}{lines:8}{code:8}{tokens:9}{tokens / max(code, 1):13.1f}")


def main(package: Path, with_list: bool) -> None:
    """Print the table and the numbers below it."""
    result = counts(package)
    _print_rows(result)
    findings: list[tuple[str, list[str]]] = []
    for level in COMPLEXITY_LEVELS:
        above = sorted((one for one in result.complexities if one[0] > level), reverse=True)
        texts = [f"{number:4} {name}" for number, name in above]
        findings.append((f"functions above a complexity of {level}", texts))
    findings.append(("one-word function names that no textbook has", result.unknown_names))
    findings.append(("tuple assignments of constants", result.tuples))
    findings += [
        (f"deciding constants in {name}", texts) for name, texts in result.constants.items()
    ]
    print()
    for title, texts in findings:
        share = ""
        if texts is result.unknown_names:
            share = (
                f"  ({100 * len(texts) / max(result.single_words, 1):.0f} % of "
                f"{result.single_words} of one word, of {result.functions} in all)"
            )
        print(f"{title:55}{len(texts):5}{share}")
        if with_list:
            print("".join(f"    {text}\n" for text in texts), end="")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=PACKAGE)
    parser.add_argument("--list", action="store_true", help="print each finding with its place")
    arguments = parser.parse_args()
    main(arguments.folder, arguments.list)
