"""Sealed documents: what is written is what is read, and an edit shows."""

import json

import pytest

from dryfric_control.store.files import load_document, read_document, write_document

DATA = {"b": [0.1, 1e-300, (1, 2)], "a": {"x": "µm", "none": None}}


@pytest.fixture
def path(tmp_path):
    write_document(tmp_path / "thing.json", "thing", 3, DATA)
    return tmp_path / "thing.json"


def test_round_trip(path):
    data, intact = read_document(path, "thing", 3)
    assert intact and "checksum" not in data
    assert {key: data[key] for key in DATA} == json.loads(json.dumps(DATA))


def test_order_and_white_space_are_free(path):
    data = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(data.items()))))
    assert read_document(path, "thing", 3)[1]


@pytest.mark.parametrize(
    "edit",
    [
        lambda d: d["b"].__setitem__(0, 0.1000001),
        lambda d: d["a"].pop("none"),
        lambda d: d.update(more=1),
        lambda d: d.pop("checksum"),
        lambda d: d.update(checksum="0" * 64),
    ],
)
def test_an_edit_shows(path, edit):
    data = json.loads(path.read_text())
    edit(data)
    path.write_text(json.dumps(data))
    assert not read_document(path, "thing", 3)[1]
    with pytest.raises(ValueError, match="thing.json was changed .*checksum"):
        load_document(path, "thing", 3, dict)


@pytest.mark.parametrize(
    ("kind", "version", "words"),
    [
        ("other", 3, "is no other: it has format = 'dryfric-control thing'"),
        ("thing", 4, "version 3, .*reads 4"),
    ],
)
def test_another_kind_or_version_is_refused(path, kind, version, words):
    with pytest.raises(ValueError, match=words):
        read_document(path, kind, version)


def test_what_is_no_json_is_refused(path):
    path.write_text(path.read_text()[:-5])
    with pytest.raises(ValueError, match="thing.json is damaged: not readable as JSON"):
        read_document(path, "thing", 3)
