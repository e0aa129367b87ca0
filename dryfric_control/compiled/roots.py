"""Root finding and the length of the next step: the caller's loop evaluates its own function."""

from __future__ import annotations

from dryfric_control.compiled.cached import njit

# Safety factor of the step-size rule.
_SAFETY = 0.9
# Least factor of two successive steps.
_SHRINK = 0.1
# Largest factor of two successive steps.
_GROW = 3.0


@njit(cache=True, error_model="numpy", forceinline=True)
def secant_point(a, fa, b, fb):
    """Next point in (a, b), by the secant or in the middle; b if there is no number between."""
    # A value at `a` that is not positive (a root at the start) gives no secant.
    c = (fa * b - fb * a) / (fa - fb) if fa > 0.0 else a
    if not a < c < b:
        c = 0.5 * (a + b)
    return c if a < c < b else b


@njit(cache=True, error_model="numpy", forceinline=True)
def illinois_bracket(a, fa, b, fb, side, c, fc):
    """Bracket after an evaluation at c, by the Illinois rule: fa is positive, fb is not."""
    # The value at an end that stays twice is halved; `side`: the end that moved last, 0 at first.
    if fc > 0.0:
        return c, fc, b, (0.5 * fb if side == 1 else fb), 1
    return a, (0.5 * fa if side == -1 else fa), c, fc, -1


@njit(cache=True, error_model="numpy", forceinline=True)
def margin_step(length, margin, rate, finest):
    """Length of a stretch to look at instead of one in which a margin may vanish."""
    # To the first instant at which it may, given its largest rate, or to half of the stretch.
    first = min(margin / rate, 0.9 * length) if rate > 0.0 else 0.0
    return max(0.5 * length, first, finest)


@njit(cache=True, error_model="numpy", forceinline=True)
def smaller_step(d, allowed, error):
    """Step length after one of length d whose error, of order 5, was too large."""
    return d * max(_SHRINK, _SAFETY * (allowed / error) ** 0.2)


@njit(cache=True, error_model="numpy", forceinline=True)
def larger_step(d, allowed, error):
    """Step length after one of length d whose error, of order 5, was allowed."""
    return d * min(_GROW, _SAFETY * (allowed / max(error, 1e-300)) ** 0.2)
