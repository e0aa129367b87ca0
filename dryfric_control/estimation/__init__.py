"""Estimation: windows, free parameters, least squares, likelihood, uncertainty."""
