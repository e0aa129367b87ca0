"""Files: axes, batches of results, writing without half-written files."""
