"""Joint springs, the stiffness with all pairs stuck, its one factor, checked solves."""
