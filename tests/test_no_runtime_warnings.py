"""No RuntimeWarning of numpy reaches the user, also from records at the edge of what is usual."""

import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest

import dryfric_control as dfc

AXIS = dfc.FrictionAxis(mass=2.0, viscous=15.0, coulomb=8.0)
T = 1e-3 * np.arange(3000)
PUSH = 20.0 * np.sin(6.0 * T) + 12.0 * np.sin(17.0 * T + 1.0)


def moved(u, quantum=0.0, v0=0.0):
    x = AXIS.simulate(u, 1e-3, v0=v0).y[0]
    return u, quantum * np.round(x / quantum) if quantum else x


RECORDS = {
    "exact": moved(PUSH),
    "coarse": moved(PUSH, quantum=1e-3),
    "one way": moved(12.0 + np.sin(9.0 * T)),
    "rests first": moved(np.where(T > 2.0, 12.0, 3.0)),
    "no drive": moved(np.zeros(T.size), v0=3.0),
    "tiny": tuple(1e-9 * one for one in moved(PUSH)),
    "huge": tuple(1e9 * one for one in moved(PUSH)),
}
CALLS = {
    "check": lambda record: str(record.check()) + record.summary(),
    "plot": lambda record: record.plot(),
    "force map": lambda record: record.force_map(AXIS).plot(),
    "explore": lambda record: record.explore(AXIS).png(),
    "axis_from": lambda record: dfc.axis_from(record),
    "replay": lambda record: str(dfc.replay(AXIS, record)),
    "levels": lambda record: str(dfc.identify_coulomb(record)),
    "levels of an axis": lambda record: str(dfc.identify_coulomb(record, axis=AXIS)),
    "fit": lambda record: dfc.fit(AXIS, record, free=("coulomb",), starts=1).table("csv"),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_typical_calls_are_quiet(call):
    for name, (u, x) in RECORDS.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            warnings.simplefilter("error", RuntimeWarning)
            try:
                call(dfc.Record(T, u, x, name=name))
            except ValueError:  # refused with words
                pass
        plt.close("all")
