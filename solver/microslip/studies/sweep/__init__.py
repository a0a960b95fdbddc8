"""Peaks over grids and samples of a scene's numbers: `microslip sweep`."""
