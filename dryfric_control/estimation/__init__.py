"""Estimation: windows, parameters, one problem, uncertainty."""
