"""Run a function over many cases, and keep what is finished."""

from __future__ import annotations

import functools
import json
import multiprocessing
import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import IO, Any

import joblib
import numpy as np
from tqdm import tqdm

from dryfric_control.store.files import file_path, write_file

# First entry of every store: what the file is, and how it is laid out.
_FORMAT = "dryfric-control batch 1"
_WATCH = 0.5  # s between two looks of a worker at the run that started it
_MEND = "give another file, or delete this one to start afresh"


def run_batch(
    function: Callable[[Any], Any],
    cases: Mapping[Any, Any],
    *,
    store: str | os.PathLike[str] | None = None,
    settings: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    progress: bool = True,
    failures: str = "raise",
) -> dict[Any, Any]:
    """Run a function over cases and store finished results.

    Parameters
    ----------
    function : callable
        ``function(value)`` of one case; returns what JSON holds: numbers, text,
        lists, dicts.  Other processes must be able to import it.
    cases : mapping
        Value of each case by its key: a number, text, or a tuple of such.
    store : path-like, optional
        File with a line of JSON for each result, written as soon as it is ready.  Cases that it
        already holds are not run again.
    settings : mapping, optional
        What else the results depend on, ready for JSON.  A store with others is refused.
    jobs : int, optional
        Cases at the same time, -1 for one a core.  Default: by `joblib.parallel_config`, else one.
    progress : bool, optional
    failures : {"raise", "return"}, optional
        What becomes of an error that `function` raises: raised once all other cases are finished,
        or returned, as the exception in place of the result.

    Returns
    -------
    dict
        Result of each case by its key, in the order of `cases`, as JSON gives it back.

    Raises
    ------
    ValueError
        If an argument is out of its range, or the store is of other settings.
    Exception
        The first that `function` raised, with a note that names the case, when all others are
        finished; with ``failures="return"`` only if no case has a result.

    Notes
    -----
    Two runs must not write one store at the same time.  NaN stands in it as NaN.  A case that
    failed is not stored: the next run tries it again.

    Examples
    --------
    >>> import math, pathlib, tempfile
    >>> import dryfric_control as dfc
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = pathlib.Path(folder, "roots.jsonl")
    ...     _ = dfc.run_batch(math.sqrt, {"a": 4.0, "b": 9.0}, store=store, progress=False)
    ...     dfc.run_batch(math.sqrt, {"b": 9.0, "c": 16.0}, store=store, progress=False)  # c alone
    {'b': 3.0, 'c': 4.0}
    """
    _check_batch(function, cases, settings, jobs, failures)
    keys = {_text("cases", key): key for key in cases}
    held = json.loads(_text("settings", dict(settings or {})))
    heading = {"store": _FORMAT, "settings": held}
    done = {} if store is None else _stored_results(store, heading)
    left = [text for text in keys if text not in done]
    if left:
        work = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(
            joblib.delayed(_run)(function, text, cases[keys[text]]) for text in left
        )
        bar = tqdm(
            work,
            desc="batch",
            unit="case",
            total=len(keys),
            initial=len(keys) - len(left),
            disable=not progress,
        )
        with _store_file(store, heading) as file:
            for text, result in bar:
                if isinstance(result, Exception):
                    done[text] = result
                    continue
                file.write(f'{{"case": {text}, "result": {result}}}\n')
                done[text] = json.loads(result)
    found = {key: done[text] for text, key in keys.items()}
    raise_failures(found, all_only=failures == "return")
    return found


def _check_batch(function: Any, cases: Any, settings: Any, jobs: Any, failures: str) -> None:
    """Refuse what `run_batch` cannot run."""
    if not callable(function):
        raise ValueError(f"function must be callable with one case, got {function!r}")
    if not isinstance(cases, Mapping):
        raise ValueError(
            f"cases must be a mapping of keys to values, got {type(cases).__name__}: "
            "dict(enumerate(values)) numbers them"
        )
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(jobs, int) or jobs == 0):
        raise ValueError(f"jobs must be a whole number other than 0, or None, got {jobs!r}")
    if failures not in ("raise", "return"):
        raise ValueError(f'failures must be "raise" or "return", got {failures!r}')
    if settings is not None and not isinstance(settings, Mapping):
        raise ValueError(f"settings must be a mapping of names to values, got {settings!r}")


def raise_failures(results: Mapping[Any, Any], all_only: bool) -> None:
    """Raise the first exception among results; with `all_only` where there is nothing else."""
    failed = [one for one in results.values() if isinstance(one, Exception)]
    if failed and not (all_only and len(failed) < len(results)):
        raise failed[0]


def fingerprint(*values: Any, without: tuple[type, ...] = ()) -> str:
    """Short text of what values hold, or of their pickles; classes `without` are passed over."""
    return str(joblib.hash(_hashable_content(values, without)))[:16]


def _hashable_content(value: Any, without: tuple[type, ...]) -> Any:
    """What a value holds, alike for two that hold the same."""
    if isinstance(value, without):
        return None
    if is_dataclass(value) and not isinstance(value, type):
        # By its fields: an object may also hold what it has worked out from them.
        held = [_hashable_content(getattr(value, item.name), without) for item in fields(value)]
        return type(value).__qualname__, held
    if isinstance(value, Mapping):
        return {key: _hashable_content(one, without) for key, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [_hashable_content(one, without) for one in value]
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return np.array(value, order="C")
    if isinstance(value, (np.generic, str, int, float, type(None))):
        return value.item() if isinstance(value, np.generic) else value
    try:
        return joblib.hash(value)
    except Exception as problem:  # whatever its own way of being pickled raises
        raise ValueError(
            f"store: results for {value!r} cannot be kept, as it cannot be pickled "
            f"({problem}); make it an object of a class that a module defines"
        ) from None


def _text(name: str, value: Any) -> str:
    try:
        return json.dumps(value, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError, RecursionError) as problem:
        raise ValueError(
            f"{name} must be finite numbers, text, or tuples of such, got {value!r}: {problem}"
        ) from None


def _run(function: Callable[[Any], Any], text: str, value: Any) -> tuple[str, str | Exception]:
    """One case, where joblib runs it: its result as JSON, or what it raised."""
    _end_with_the_run()
    try:
        result = function(value)
    except Exception as problem:
        problem.add_note(f"in case {text}")
        return text, problem
    try:
        return text, json.dumps(result)
    except (TypeError, ValueError, RecursionError) as problem:
        raise ValueError(
            f"function must return numbers, text, lists or dicts, got {type(result).__name__} "
            f"for case {text}: {problem}; arrays have tolist()"
        ) from None


@functools.cache
def _end_with_the_run() -> None:
    """In a worker: end as soon as the process that started it is no more."""
    # Idle workers wait for minutes for another case, busy ones finish theirs for nobody.
    parent = multiprocessing.parent_process()
    if parent is None:  # no worker: the run itself, or a thread of it
        return

    def watch() -> None:
        # An orphan gets another parent (on Windows it keeps the number: nothing is seen there).
        while os.getppid() == parent.pid:
            time.sleep(_WATCH)
        os._exit(1)

    threading.Thread(target=watch, name="ends with the run", daemon=True).start()


def _whole_lines(path: Path) -> bytes:
    """All of a store but a last line that was cut short."""
    raw = path.read_bytes()
    return raw[: raw.rfind(b"\n") + 1]


def _stored_results(store: str | os.PathLike[str], heading: dict[str, Any]) -> dict[str, Any]:
    """Results that a store holds, by the text of their case."""
    path = file_path("store", store)
    if path.is_dir():
        raise ValueError(f"store {path} is a folder: name a file in it")
    if not path.parent.is_dir():
        raise ValueError(f"store {path} lies in a folder that does not exist: make it first")
    if not path.exists():
        return {}
    first, *lines = _whole_lines(path).split(b"\n")
    made = _json_line(first)
    if not isinstance(made, dict) or made.get("store") != _FORMAT:
        raise ValueError(f"store {path} is no store of a batch: {_MEND}")
    there = made.get("settings")
    here = heading["settings"]
    if there != here:
        there = there if isinstance(there, dict) else {}
        names = sorted(n for n in there.keys() | here.keys() if there.get(n) != here.get(n))
        other = ", ".join(f"{n} is {here.get(n)!r} and was {there.get(n)!r}" for n in names)
        raise ValueError(f"store {path} was made by other settings: {other}; {_MEND}")
    done = {}
    for number, line in enumerate(lines[:-1], start=2):
        entry = _json_line(line)
        if not isinstance(entry, dict) or entry.keys() != {
            "case",
            "result",
        }:
            raise ValueError(f"store {path} is damaged in line {number}: {_MEND}")
        done[_text("cases", entry["case"])] = entry["result"]
    return done


def _json_line(line: bytes) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None


def _store_file(store: str | os.PathLike[str] | None, heading: dict[str, Any]) -> IO[str]:
    """The store, to which each line is written at once; without one, lines go nowhere."""
    path = Path(os.devnull if store is None else store)
    if store is not None and path.exists():
        os.truncate(path, len(_whole_lines(path)))
    elif store is not None:
        # Whole or not at all: a file without a heading is not taken for a store.
        write_file(path, json.dumps(heading) + "\n")
    return path.open("a", buffering=1, encoding="utf-8", newline="\n")
