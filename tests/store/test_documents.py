"""Sealed documents: what is written is what is read, and an edit shows."""

import json

import pytest

from dryfric_control.store import saved
from dryfric_control.store.saved import read_document, write_document

DATA = {"b": [0.1, 1e-300, (1, 2)], "a": {"x": "µm", "none": None}}


@pytest.fixture
def path(tmp_path):
    write_document(tmp_path / "thing.json", "thing", DATA)
    return tmp_path / "thing.json"


def test_order_and_white_space_are_free(path):
    whole = json.loads(path.read_text())
    path.write_text(json.dumps(dict(reversed(whole.items()))))
    data, intact = read_document(path, "thing")
    assert intact and "checksum" not in data
    assert {key: data[key] for key in DATA} == json.loads(json.dumps(DATA))


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
    assert not read_document(path, "thing")[1]


def test_another_kind_or_version_is_refused(path, monkeypatch):
    with pytest.raises(ValueError, match="is no other: it has format = 'dryfric-control thing'"):
        read_document(path, "other")
    monkeypatch.setattr(saved, "VERSION", 2)
    with pytest.raises(ValueError, match="version 1, .*reads 2"):
        read_document(path, "thing")


def test_an_older_version_is_brought_up_step_by_step(path, monkeypatch):
    monkeypatch.setattr(saved, "VERSION", 3)
    monkeypatch.setitem(saved.MIGRATIONS, 1, lambda kind, data: data | {"a": kind})
    monkeypatch.setitem(saved.MIGRATIONS, 2, lambda kind, data: data | {"b": data["a"] + "s"})
    data, intact = read_document(path, "thing")
    assert intact and (data["a"], data["b"]) == ("thing", "things")
