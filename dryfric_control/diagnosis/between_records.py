"""Parameters that differ from record to record."""

from __future__ import annotations

from typing import Any

from dryfric_control.diagnosis.likelihood_search import Search
from dryfric_control.estimation.likelihood import BASE
from dryfric_control.estimation.solution import Solution

# Growth of the standard errors of record-specific parameters, by one parameter more, beyond which
# the two cannot be separated.
_BLURRED = 2.0
# Iterations of a trial fit with one more record-specific parameter, and its largest further gain
# over the predicted gain of its last step.
_OWN_TURNS, _OWN_AHEAD = 3, 3.0


def varying(search: Search, final: Solution) -> tuple[dict[str, dict[str, list[float]]], Solution]:
    """Parameters that differ between records, with standard errors, and the fit with them."""
    if len(search.runs) < 2:
        return {}, final
    names, free = list(final.problem.names), search.free_of(final)
    base = [n for n in BASE if n not in search.known and n not in free]
    noises = final.z[len(names) :]
    own = list(search.own)
    now = final
    while not search.late:
        best = None
        for name in dict.fromkeys([*base, *free]):
            if name in own:
                continue
            search.own = (*own, name)
            settings: dict[str, Any] = {
                "base": [n for n in base if n in names or n in search.own],
                "wonder": False, "runs": search.runs,
            }  # fmt: skip
            # Most parameters do not differ; a few iterations show it.
            some = search.fit(final.axis, free, noises, _OWN_TURNS, **settings)
            hoped = now.cost - some.cost + _OWN_AHEAD * some.promised
            if search.worth(hoped, len(search.runs) - 1) < 0.0:
                continue
            one = search.fit(final.axis, free, noises, **settings)
            gain = search.worth(now.cost - one.cost, len(search.runs) - 1)
            if not _apart(now, one):
                continue
            if best is None or gain > best[0]:
                best = (gain, name, one)
        if best is None or best[0] < 0.0:
            break
        own.append(best[1])
        now = best[2]
    search.own = tuple(own)
    values, errors = now.values(), now.standard_errors()
    count = range(len(search.runs))
    return {
        n: {
            "values": [values[f"{n}@{i}"] for i in count],
            "standard_errors": [errors[f"{n}@{i}"] for i in count],
        }
        for n in own
    }, now


def _apart(less: Solution, more: Solution) -> bool:
    """Whether the record-specific parameters of two fits can be separated.

    The new parameter of `more` must not blur the standard errors of the earlier ones, and
    its own must be smaller than its spread over the records.
    """
    before, after = less.standard_errors(), more.standard_errors()
    values = more.values()
    new = [n for n in after if "@" in n and n not in before]
    differ = max(values[n] for n in new) - min(values[n] for n in new)
    return all(after[n] < _BLURRED * before[n] for n in before if "@" in n) and all(
        after[n] < differ for n in new
    )
