"""Property tests try the same examples everywhere, as long as it takes; figures need no window."""

from collections.abc import Iterator

import matplotlib
import matplotlib.pyplot as plt
import pytest
from hypothesis import settings

settings.register_profile("seeded", deadline=None, derandomize=True)
settings.load_profile("seeded")
matplotlib.use("Agg")


@pytest.fixture(autouse=True)
def figures_closed() -> Iterator[None]:
    """A test leaves no figure behind."""
    yield
    plt.close("all")
