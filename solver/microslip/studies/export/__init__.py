"""The command `export`: the reduced model for other programs, with scripts that solve it there."""
