"""The warning for data that look wrong."""

from __future__ import annotations

from dryfric_control import checks


class RecordWarning(UserWarning):
    """Data that can be used but look suspicious.

    Examples
    --------
    Time in milliseconds, taken for seconds:

    >>> import warnings
    >>> import numpy as np
    >>> import dryfric_control as dfc
    >>> t = np.arange(2000.0)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     record = dfc.Record(t, np.cos(3e-3 * t), np.sin(3e-3 * t))
    >>> caught[0].category is dfc.RecordWarning
    True
    """


def warn(message: str) -> None:
    """Warn of data that look wrong."""
    checks.warn(message, RecordWarning)
