"""Logs of BAM (better actuator models), a servo test bench."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from dryfric_control.store.files import read_json

BAM_FULL_DUTY = 885.0  # `load` at 100 % PWM duty of the XL330
BAM_KEYS = "timestamp position goal_position load input_volts temp torque_enable".split()


def read_bam_entries(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Head and columns of a BAM servo log (JSON): signed ``duty`` for `load`, else as stored."""
    content = read_json(path)
    entries = content.get("entries") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"{path} is no BAM log: it has no list `entries`")
    columns: dict[str, Any] = {}
    for key in BAM_KEYS:
        values = [e.get(key) if isinstance(e, dict) else None for e in entries]
        bad = next((k for k, v in enumerate(values) if not isinstance(v, (int, float))), None)
        if bad is not None:
            raise ValueError(
                f"{path}: entry {bad} has {key} = {str(values[bad])[:40]}, not a number"
            )
        try:
            columns[key] = np.array(values, dtype=float)
        except OverflowError as err:
            raise ValueError(f"{path}: {key} holds a number that is too large") from err
    load = columns.pop("load")  # unsigned 16 bit on the wire
    columns["duty"] = np.where(load > 32767, load - 65536, load) / BAM_FULL_DUTY
    return {k: v for k, v in content.items() if k != "entries"}, columns
