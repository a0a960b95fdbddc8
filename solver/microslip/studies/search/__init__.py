"""Other solutions at a frequency: ``microslip search``."""
