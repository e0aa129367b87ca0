"""Independent truth for blind tests: shares no code with the product.

`plant` integrates the physics, `reference` excites it, `bench` draws random
axes, encoders, controllers and hidden effects and returns the record, `recorder`
spoils what a logger writes down of it.
"""

from .bands import ADDED
from .bench import (
    CONDITIONS,
    EFFECTS,
    EQUAL,
    OUTSIDE,
    Case,
    make_case,
    make_machine,
    make_null,
    make_outside,
    make_pair,
)
from .plant import Plant, closed_loop, free_runs, open_loop
from .recorder import RECORDERS

__all__ = [
    "ADDED",
    "CONDITIONS",
    "EFFECTS",
    "EQUAL",
    "OUTSIDE",
    "RECORDERS",
    "Case",
    "Plant",
    "closed_loop",
    "free_runs",
    "make_case",
    "make_machine",
    "make_null",
    "make_outside",
    "make_pair",
    "open_loop",
]
