"""Model files: read whole, written whole; attributes set in XML of which every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

from dryfric_control.simulators.joint_values import SimulatorValues
from dryfric_control.store.files import existing_file, file_path, write_file

# An attribute in a start tag, and the end of the tag; quoted values may contain ">".
_ATTRIBUTE = rb"""\s+(%s)\s*=\s*("[^"]*"|'[^']*')"""
_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*(\s*/?>)""")


def read_model(model: Any, out: Any) -> tuple[Path, bytes, Path]:
    """Path and bytes of a model file, and where to write it."""
    path = existing_file(file_path("model", model))
    return path, path.read_bytes(), path if out is None else file_path("out", out)


def written(found: SimulatorValues, path: Path, content: bytes) -> SimulatorValues:
    """The values, once the file is there."""
    write_file(path, content)
    return replace(found, files=(path,))


class Edit(NamedTuple):
    """Bytes that take the place of others."""

    begin: int
    end: int
    new: bytes


def applied(raw: bytes, edits: Iterable[Edit]) -> bytes:
    """The file with all edits, which do not overlap."""
    for edit in sorted(edits, reverse=True):
        raw = raw[: edit.begin] + edit.new + raw[edit.end :]
    return raw


def number(value: float) -> str:
    """A number with six digits, as every format reads it."""
    return f"{value:.6g}"


class Element(NamedTuple):
    """A start tag: where it begins, its attributes, its parent's name, how deep it is."""

    at: int
    name: str
    attributes: dict[str, str]
    path: tuple[str, ...]


def elements(path: Path, raw: bytes, kind: str, first: str) -> list[Element]:
    """Start tags in order of a file of a kind, which begins with a certain one."""
    found: list[Element] = []
    inside: list[str] = []
    parser = expat.ParserCreate()

    def start(name: str, attributes: dict[str, str]) -> None:
        found.append(Element(parser.CurrentByteIndex, name, attributes, tuple(inside)))
        inside.append(name)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: inside.pop()
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
    tag = raw[at : match.start(1)]
    for name, value in values.items():
        here = re.search(_ATTRIBUTE % name.encode(), tag)
        if here:
            quote = here[2][:1]
            tag = tag[: here.start(2)] + quote + value.encode() + quote + tag[here.end(2) :]
        else:
            tag += f' {name}="{value}"'.encode()
    return Edit(at, match.end(), tag + match[1])


def child_added(raw: bytes, at: int, child: str) -> Edit:
    """An element put first into the one that begins at a byte, indented as what follows."""
    end = _tag(raw, at).end()
    space = raw[end : end + len(raw[end:]) - len(raw[end:].lstrip())]
    return Edit(end, end, space + child.encode())


def _tag(raw: bytes, at: int) -> re.Match[bytes]:
    match = _TAG.match(raw, at)
    assert match is not None  # expat has read it
    return match
