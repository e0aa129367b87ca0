"""The line that says what a long computation does."""

import io
import logging
import sys
import types

import pytest

from dryfric_control.progress import ProgressLine


class Terminal(io.StringIO):
    def isatty(self):
        return True


def line_of(stream, clock):
    return ProgressLine("diagnose", stream=stream, clock=lambda: clock[0])


def test_a_terminal_has_one_line_that_is_overwritten(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    stream, clock = Terminal(), [100.0]
    with pytest.raises(KeyboardInterrupt), line_of(stream, clock) as progress:
        progress("force view, a long name of a step that does not fit", ["cogging", "bias force"])
        clock[0] = 103.0
        progress("fit 1 of 3", expected=20.0)
        clock[0] = 125.0
        raise KeyboardInterrupt
    empty, first, second, last = stream.getvalue().split("\r")
    assert empty == "" and stream.getvalue().count("\n") == 1
    assert len(first) == 59 and first.endswith("bias force | 0.0 s") and "..." in first
    # As long as the line before, so that nothing of it is left.
    assert second.rstrip() == "diagnose: fit 1 of 3 | so far: none | 3.0 of about 20 s"
    assert len(second) == len(first)
    assert last.rstrip() == "diagnose: fit 1 of 3 | so far: none | 25 s"


def test_elsewhere_the_steps_go_to_the_log(caplog):
    stream, clock = io.StringIO(), [0.0]
    with caplog.at_level(logging.INFO, "dryfric_control"), line_of(stream, clock) as progress:
        clock[0] = 1.5
        progress("fit", ["spring"])
    assert stream.getvalue() == ""
    assert caplog.messages == ["fit (1.5 s, causes so far: spring)"]


def test_a_notebook_has_one_output_that_is_replaced(monkeypatch):
    shown = []
    handle = types.SimpleNamespace(update=lambda data, raw: shown.append(data["text/plain"]))
    kernel = types.SimpleNamespace(kernel=object())
    module = types.ModuleType("IPython")
    module.get_ipython = lambda: kernel
    module.display = types.ModuleType("IPython.display")
    module.display.display = lambda *given, **options: handle
    monkeypatch.setitem(sys.modules, "IPython", module)
    monkeypatch.setitem(sys.modules, "IPython.display", module.display)
    with ProgressLine("diagnose", clock=lambda: 0.0) as progress:
        progress("fit", ["spring"])
    assert shown == ["diagnose: fit | so far: spring | 0.0 s"] * 2
