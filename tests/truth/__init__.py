"""Independent truth for blind tests: shares no code with the product.

`plant` integrates the physics, `reference` excites it, `bench` draws random
axes, encoders, controllers and hidden effects and returns the record, `recorder`
spoils what a logger writes down of it.
"""

from .bands import ADDED, EFFECTS
from .bench import CONDITIONS, Case, make_case, make_machine, make_null, make_outside, make_pair
from .plant import Plant, closed_loop, open_loop
from .recorder import RECORDERS

__all__ = [
    "ADDED", "CONDITIONS", "EFFECTS", "RECORDERS", "Case", "Plant", "closed_loop", "make_case",
    "make_machine", "make_null", "make_outside", "make_pair", "open_loop",
]  # fmt: skip
