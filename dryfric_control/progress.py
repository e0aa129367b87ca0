"""One line that says what a long computation does: the step, the best so far, the time."""

from __future__ import annotations

import logging
import shutil
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

_LOG = logging.getLogger("dryfric_control")
# Time after which the line is drawn again although no step has begun [s].
_REFRESH = 1.0
# Width of a line where a terminal does not say its own [characters].
_WIDTH = 100


class ProgressLine:
    """Progress on one line of a terminal or of a notebook; elsewhere the steps go to a log.

    A context manager, and a function of a step and of what is found so far.  The line is drawn
    again every second, so that a long step is seen to go on, and stays when the work ends, also
    where an interrupt ends it.

    Parameters
    ----------
    title : str
        What is done, such as "diagnose".
    shown : bool, optional
        Whether to show the line.  Default: in a terminal or a notebook.
    stream : file, optional
        Where the line goes outside a notebook.  Default: the standard error.
    clock : callable, optional
        Time [s].

    Examples
    --------
    >>> from dryfric_control.progress import ProgressLine
    >>> with ProgressLine("diagnose", shown=False, clock=lambda: 0.0) as progress:
    ...     progress("fit 3 of 8", ["cogging"], expected=20.0)
    ...     print(progress.text())
    diagnose: fit 3 of 8 | so far: cogging | 0.0 of about 20 s
    """

    def __init__(
        self,
        title: str,
        shown: bool | None = None,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._title = title
        self._stream = sys.stderr if stream is None else stream
        self._page = _notebook_handle() if stream is None else None
        self.shown = self._stream.isatty() or self._page is not None if shown is None else shown
        self._clock = clock
        self._begun = clock()
        self._step = "starting"
        self._found: tuple[str, ...] = ()
        self._expected: float | None = None
        self._written = 0
        self._lock = threading.Lock()
        self._ended = threading.Event()

    def __enter__(self) -> ProgressLine:
        if self.shown:
            threading.Thread(target=self._keep_drawing, daemon=True).start()
        return self

    def __exit__(self, *ended: Any) -> None:
        self._ended.set()
        if self.shown:
            self.draw()
            if self._page is None:
                self._stream.write("\n")
                self._stream.flush()

    def __call__(self, step: str, found: Sequence[str] = (), expected: float | None = None) -> None:
        """Begin a step.

        `found`: names of what is found so far; `expected`: time that all is likely to take [s].
        """
        self._step, self._found, self._expected = step, tuple(found), expected
        if self.shown:
            self.draw()
        else:
            so_far = ", ".join(found) or "none"
            _LOG.info("%s (%.1f s, causes so far: %s)", step, self.elapsed_time, so_far)

    @property
    def elapsed_time(self) -> float:
        """Time since the beginning [s]."""
        return self._clock() - self._begun

    def text(self) -> str:
        """The line as it stands now."""
        so_far = ", ".join(self._found) or "none"
        spent = _duration_text(self.elapsed_time)
        if self._expected is not None and self._expected > self.elapsed_time:
            spent += f" of about {_duration_text(self._expected)}"
        return f"{self._title}: {self._step} | so far: {so_far} | {spent} s"

    def draw(self) -> None:
        """Show the line in place of the one before."""
        with self._lock:
            line = self.text()
            if self._page is not None:
                self._page.update({"text/plain": line}, raw=True)
                return
            # A line that wraps could not be overwritten; the time at its end is kept.
            room = shutil.get_terminal_size((_WIDTH, 24)).columns - 1
            if len(line) > room:
                line = f"{line[: room // 2 - 3]}...{line[len(line) - (room - room // 2) :]}"
            self._stream.write(f"\r{line.ljust(self._written)}")
            self._stream.flush()
            self._written = len(line)

    def _keep_drawing(self) -> None:
        while not self._ended.wait(_REFRESH):
            self.draw()


def _duration_text(time: float) -> str:
    return f"{time:.1f}" if time < 10.0 else f"{time:.0f}"


def _notebook_handle() -> Any:
    """Handle of an output in a notebook; None elsewhere, in IPython's own terminal too."""
    # Other libraries import IPython too: only a running shell of a kernel has a page.
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if shell is None or getattr(shell, "kernel", None) is None:
        return None
    from IPython.display import display

    return display({"text/plain": ""}, raw=True, display_id=True)
