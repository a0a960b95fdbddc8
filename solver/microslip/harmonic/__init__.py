"""The equations of harmonic balance, condensed to the relative motion of the pairs, and their linearisation."""
