"""The catalogue of what goes wrong: bad inputs and faults as data, and how each is judged.

``jobs/bench/try_catalogue.py`` starts each of them as a user would; the tests beside this file do it in one process.
"""
