"""Continuation: problems, constraint rows, corrector, steps, first points, records and checkpoints of a branch."""
