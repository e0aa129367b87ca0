"""Model files: read whole, written whole; attributes set in XML of which every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat
from xml.sax.saxutils import escape

from dryfric_control.simulators.joint_values import SimulatorValues
from dryfric_control.store.files import existing_file, file_path, write_file

# An attribute in a start tag, and the end of the tag; quoted values may contain ">".
_ATTRIBUTE = re.compile(rb"""\s+([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")
_TAG = re.compile(rb"""(<[^\s/>]+)((?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*)(\s*/?>)""")


def read_model(model: Any, out: Any) -> tuple[Path, bytes, Path]:
    """Path and bytes of a model file, and where to write it."""
    path = existing_file(file_path("model", model))
    return path, path.read_bytes(), path if out is None else file_path("out", out)


def write_values(found: SimulatorValues, path: Path, content: bytes) -> SimulatorValues:
    """The values, once the file is there."""
    write_file(path, content)
    return replace(found, files=(path,))


class Edit(NamedTuple):
    """Bytes that take the place of others."""

    begin: int
    end: int
    new: bytes


def apply_edits(raw: bytes, edits: Iterable[Edit]) -> bytes:
    """The file with all edits, which do not overlap."""
    for edit in sorted(edits, reverse=True):
        raw = raw[: edit.begin] + edit.new + raw[edit.end :]
    return raw


def number(value: float) -> str:
    """A number with six digits, as every format reads it."""
    return f"{value:.6g}"


def quote_attribute(text: str) -> str:
    """Text as the value of an attribute of XML, with its quotation marks."""
    escapes = {'"': "&quot;"} | {character: f"&#{ord(character)};" for character in "\t\n\r"}
    return f'"{escape(text, escapes)}"'


class Element(NamedTuple):
    """A start tag of a file."""

    at: int  # its first byte
    name: str
    attributes: dict[str, str]
    path: tuple[str, ...]  # names of the elements around it, from the outermost
    around: tuple[int, ...]  # the same by their places in the list of elements
    end: int = 0  # first byte of its end tag


def elements(path: Path, raw: bytes, kind: str, first: str) -> list[Element]:
    """Start tags in order of a file of a kind, which begins with a certain one."""
    found: list[Element] = []
    around: list[int] = []
    parser = expat.ParserCreate()

    def start(name: str, attributes: dict[str, str]) -> None:
        names = tuple(found[i].name for i in around)
        found.append(Element(parser.CurrentByteIndex, name, attributes, names, tuple(around)))
        around.append(len(found) - 1)

    def end(name: str) -> None:
        i = around.pop()
        found[i] = found[i]._replace(end=parser.CurrentByteIndex)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(raw, True)
    except expat.ExpatError as problem:
        raise ValueError(f"{path.name} is no XML: {problem}") from None
    if any(raw[one.at : one.at + 1] != b"<" or raw[one.at + 1 : one.at + 2] == b"\0"
           for one in found):  # fmt: skip
        raise ValueError(f"{path.name} is not in UTF-8: save it so")
    if found[0].name != first:
        raise ValueError(
            f"model {path.name} is no {kind} file: it begins with <{found[0].name}>, not <{first}>"
        )
    return found


def attributes_set(raw: bytes, at: int, values: Mapping[str, str]) -> Edit:
    """The start tag that begins at a byte, with attributes set."""
    match = _tag(raw, at)
    missing = dict(values)
    tag = match[1]
    for one in _ATTRIBUTE.finditer(match[2]):
        name = one[1].decode()
        if name in missing:
            # Quotation marks and blanks stay as they are.
            new = quote_attribute(missing.pop(name))[1:-1].replace("'", "&#39;").encode()
            begin = one.start(2) - one.start() + 1
            end = one.end(2) - one.start() - 1
            tag += one[0][:begin] + new + one[0][end:]
        else:
            tag += one[0]
    tag += "".join(f" {name}={quote_attribute(value)}" for name, value in missing.items()).encode()
    return Edit(at, match.end(), tag + match[3])


def child_added(raw: bytes, at: int, child: str) -> Edit:
    """An element put first into the one that begins at a byte, indented as what follows."""
    end = _tag(raw, at).end()
    space = raw[end : end + len(raw[end:]) - len(raw[end:].lstrip())]
    return Edit(end, end, space + child.encode())


def child_appended(raw: bytes, end: int, child: str) -> Edit:
    """An element put last into the one whose end tag begins at a byte."""
    before = raw[:end]
    space = before[len(before.rstrip()) :]
    indent = space + b"  " if b"\n" in space else space
    return Edit(end - len(space), end, indent + child.encode() + space)


def remove_element(raw: bytes, at: int) -> Edit:
    """An element without content that begins at a byte, taken out with the blanks before it."""
    before = raw[:at]
    end = _tag(raw, at).end()
    closing = re.compile(rb"\s*</[^>]*>").match(raw, end) if raw[end - 2 : end] != b"/>" else None
    return Edit(len(before.rstrip()), closing.end() if closing else end, b"")


def _tag(raw: bytes, at: int) -> re.Match[bytes]:
    match = _TAG.match(raw, at)
    assert match is not None  # expat has read it
    return match
