"""Reduction of the stuck structure to the receptance of its pairs: one interface, the methods in methods/, choice of modes."""
