"""The command line and what it checks before anything is solved."""
