"""What holds for every test and every example of a docstring."""

import os
from collections import Counter
from collections.abc import Iterator

# Before numpy is loaded: workers that share the cores would each wait for the threads of BLAS.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

# Whole, before any worker runs: pytest's main process opens the warnings of two workers in two
# threads, and two threads that begin to import one package wait for one another.
from dryfric_control.model.effects.effect import REGISTRY

SLOW_EXAMPLES = ("diagnose", "diagnose_batch", "identify_stribeck")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Notebooks and files with many slow tests first: workers, a file at a time, end together."""
    for item in items:
        if item.path.suffix == ".ipynb" or item.name.rpartition(".")[2] in SLOW_EXAMPLES:
            item.add_marker("slow")
    slow = [item for item in items if item.get_closest_marker("slow")]
    count, place = Counter(item.path for item in slow), {}
    for item in items:
        notebook = item.path.suffix == ".ipynb"
        place.setdefault(item.path, (not notebook, -count[item.path], len(place)))
    late = {id(item) for item in items} - {id(item) for item in slow}
    items.sort(key=lambda item: (place[item.path], id(item) in late))


@pytest.fixture(autouse=True)
def registry_as_before() -> Iterator[None]:
    """Effects that a test or an example registers are gone after it, in whatever order they run."""
    before = dict(REGISTRY)
    yield
    REGISTRY.clear()
    REGISTRY.update(before)
