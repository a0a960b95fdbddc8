"""From point to point along a curve: corrector, steps, first points, the record of a branch."""
