"""The tables of a structure and of the loads on it: frozen, one class each for all rooms."""
