"""Lines of the package, room by room: all, and those that hold code.

Docstrings, comments and lines of brackets alone are no code.

python benchmarks/lines.py [folder]
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "dryfric_control"
#: Tokens that are no code.
SILENT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER, tokenize.OP,
}  # fmt: skip


def code_lines(source: str) -> int:
    """Lines that hold a name, a number or a text of the code.

    Examples
    --------
    >>> code_lines('def f(x):\\n    "Twice."\\n    # a remark\\n\\n    return 2 * x\\n')
    2
    """
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in SILENT:
            held.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                if isinstance(first.value.value, str):
                    held.difference_update(range(first.lineno, first.end_lineno + 1))
    return len(held)


def main(package: Path) -> None:
    """Print one row a room, and the sum."""
    lines: Counter[str] = Counter()
    code: Counter[str] = Counter()
    for path in sorted(package.rglob("*.py")):
        inside = path.relative_to(package).parts
        room = inside[0] if len(inside) > 1 else "(top)"
        source = path.read_text(encoding="utf-8")
        lines[room] += source.count("\n")
        code[room] += code_lines(source)
    print(f"{'room':16}{'lines':>8}{'code':>8}")
    for room in sorted(lines):
        print(f"{room:16}{lines[room]:8}{code[room]:8}")
    print(f"{'package':16}{lines.total():8}{code.total():8}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGE)
