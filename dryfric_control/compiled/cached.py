"""Where compiled functions are kept: in files that no other process writes."""

from __future__ import annotations

import atexit
import shutil
import tempfile
import uuid
import warnings
from typing import Any

import numba
from numba.core.types.misc import unliteral

# Part of the file names of this process.
_PROCESS = uuid.uuid4().hex[:12]


def njit(function: Any = None, **options: Any) -> Any:
    """`numba.njit` once for all values of an argument, in files that no other process writes.

    numba compiles a function again for each constant with which compiled code calls it.
    numba counts the files of a function by the index that it has read.  Two processes that compile
    it at once for different types of arguments give both files the same name, and whoever reads the
    index afterwards may get the code for the other types.
    """
    if function is None:
        return lambda function: njit(function, **options)
    compiled = numba.njit(function, **options)
    compiled.get_call_template = _for_any_value(compiled.get_call_template)
    file = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    pattern = getattr(file, "_data_name_pattern", None)
    if file is not None and pattern is not None:
        file._data_name_pattern = pattern.replace("{number", f"{_PROCESS}.{{number")
    return compiled


def _for_any_value(get_call_template: Any) -> Any:
    """The same for the types of arguments in place of the constants that they are."""
    return lambda args, kws: get_call_template(
        tuple(unliteral(a) for a in args), {n: unliteral(a) for n, a in kws.items()}
    )


def _probe(value: float) -> float:
    return value


def keep_compiled_code() -> None:
    """Use a temporary folder for compiled code if neither cache folder is writable."""
    # Without one numba refuses to compile for its cache, and the package could not be imported.
    try:
        numba.njit(cache=True)(_probe)
    except RuntimeError:
        folder = tempfile.mkdtemp(prefix="dryfric-control-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        numba.config.CACHE_DIR = folder
        warnings.warn(
            "no folder for compiled code can be written: it is compiled anew in every process; set "
            "the environment variable NUMBA_CACHE_DIR to a folder that can be written",
            RuntimeWarning,
            stacklevel=2,
        )
