"""The catalogue of bad inputs and faults as data, with the checks of their outcome.

``jobs/bench/try_catalogue.py`` runs each of them as a user would; the tests of this folder run bad inputs in one process.
"""
