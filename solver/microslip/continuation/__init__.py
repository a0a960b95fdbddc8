"""From point to point along a curve: problems, constraint rows, corrector, steps, first points, what is kept of a branch."""
