"""The tables that say what a structure is made of and what acts on it: frozen, one class each for all rooms."""
