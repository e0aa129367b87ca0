"""Compiled loops: one sampled step of the axis and everything built on it."""

import atexit
import shutil
import tempfile
import warnings

import numba


def _probe(value: float) -> float:
    return value


def _keep_compiled_code() -> None:
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


_keep_compiled_code()
