"""What holds for every test and every example of a docstring."""

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def registry_as_before() -> Iterator[None]:
    """Effects that a test or an example registers are gone after it, in whatever order they run."""
    from dryfric_control.model.effects.effect import REGISTRY

    before = dict(REGISTRY)
    yield
    REGISTRY.clear()
    REGISTRY.update(before)
