"""microslip: steady-state vibration of jointed structures with friction contact."""

__version__ = "0.1.0"
