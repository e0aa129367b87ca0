"""A python-control block of this package: signals keep their names, and no parameter is ignored."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import control as ct
import numpy as np

from dryfric_control.checks import string

#: Of time, state and input.
Function = Callable[[float, Any, Any], Any]
#: Least and largest value of a state that is a whole number, by name.
Ranges = Mapping[str, tuple[int, int]]

_LARGEST = 1e200  # of a sum of squares: beyond it a compiled step may overflow and not end


class Block(ct.NonlinearIOSystem):
    """Block whose numbers are those of the object it was made from.

    It is linearised with the names of its signals, and refuses `params`, which would change
    nothing.
    """

    @classmethod
    def from_functions(
        cls, update: Function | None, output: Function, inputs: str, outputs: str,
        states: Sequence[str], dt: float, name: str,
    ) -> Block:  # fmt: skip
        """Block of functions of time, state and input; names of signals between blanks."""

        def taking_params(function: Function | None) -> Any:
            if function is None:
                return None

            def check_update(t: float, x: Any, u: Any, params: Any) -> Any:
                if not np.dot(x, x) + np.dot(u, u) < _LARGEST:
                    raise ValueError(
                        f"an input or state of {name!r} is beyond 1e100 or no number at {t:g} s: "
                        "the loop diverges, lower the gains of its controller; or give it numbers"
                    )
                return function(t, x, u)

            return check_update

        return cls(
            taking_params(update), taking_params(output), inputs=inputs.split(),
            outputs=outputs.split(), states=list(states) or None, dt=dt, name=string("name", name),
        )  # fmt: skip

    @classmethod
    def from_step(
        cls, step: Function, inputs: str, outputs: str, states: Sequence[str], dt: float, name: str,
        whole: Ranges | None = None,
    ) -> Block:  # fmt: skip
        """Block of a function that advances the state it is given and returns the outputs.

        `whole`: states that the compiled step takes as indices.
        """
        indices = [(list(states).index(key), *ends) for key, ends in (whole or {}).items()]

        def sample(t: float, x: Any, u: Any) -> tuple[Any, Any]:
            state = np.array(x, dtype=float)
            for i, least, largest in indices:
                if not (least <= state[i] <= largest and state[i] == int(state[i])):
                    raise ValueError(
                        f"state {states[i]!r} of {name!r} must be a whole number from {least} to "
                        f"{largest}, got {state[i]:g}: start it at 0, and others by their names in "
                        "state_labels (find_state of an unknown name is None, which as an index "
                        "means all of them)"
                    )
            return step(t, state, u), state

        def update(t: float, x: Any, u: Any) -> Any:
            return sample(t, x, u)[1]

        def output(t: float, x: Any, u: Any) -> Any:
            return sample(t, x, u)[0]

        return cls.from_functions(update, output, inputs, outputs, states, dt, name)

    def linearize(self, *point: Any, copy_names: bool = True, **kwargs: Any) -> ct.StateSpace:
        """Linear system at a point, with the names of this block's signals."""
        return super().linearize(*point, copy_names=copy_names, **kwargs)

    def _update_params(self, params: Any, **options: Any) -> None:
        # A system hands the parameters of all its parts to each of them.
        whole: ct.NonlinearIOSystem = self
        caller: Any = sys._getframe(1)
        while isinstance(part_of := caller.f_locals.get("self"), ct.InterconnectedSystem):
            whole = part_of
            caller = caller.f_back
        if params and not _takes_parameters(whole):
            raise ValueError(
                f"params = {params!r} changes nothing: {self.name!r} keeps the numbers it was made "
                "with; change them there, as in axis.replace(mass=...), and make the block anew"
            )
        super()._update_params(params, **options)


def _takes_parameters(system: Any) -> bool:
    """Whether a part of a system is a block of the user's own."""
    if isinstance(system, ct.InterconnectedSystem):
        return any(map(_takes_parameters, system.syslist))
    return not isinstance(system, (Block, ct.StateSpace))
