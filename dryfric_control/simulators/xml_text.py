"""Attributes set in an XML file of which every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from dryfric_control.simulators.files import Edit

# An attribute in a start tag, and the end of the tag; quoted values may contain ">".
_ATTRIBUTE = rb"""\s+(%s)\s*=\s*("[^"]*"|'[^']*')"""
_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*(\s*/?>)""")


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
