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

# Its functions are those of the modules, whose examples are run there.
collect_ignore = ["dryfric_control/__init__.py"]

SLOW_EXAMPLES = ("diagnose", "diagnose_batch")
# What takes more than ten seconds and has no function for a mark: examples, notebooks, pages.
LONG = (
    "identify_stribeck",
    "02_block_diagram.ipynb",
    "03_identify_friction.ipynb",
    "06_your_own_effect.ipynb",
    "07_compensate_friction.ipynb",
    "test_code_of_the_pages_runs[docs/howto/add_effect.md]",
)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Notebooks and files with many slow tests first: workers, a file at a time, end together."""
    for item in items:
        example = item.name.rpartition(".")[2]
        if {item.name, item.path.name, example} & {*LONG}:
            item.add_marker("long")
        notebook = item.path.suffix == ".ipynb"
        if notebook or example in SLOW_EXAMPLES or item.get_closest_marker("long"):
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
