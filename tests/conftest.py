"""Property tests try the same examples everywhere, and as long as it takes."""

from hypothesis import settings

settings.register_profile("seeded", deadline=None, derandomize=True)
settings.load_profile("seeded")
