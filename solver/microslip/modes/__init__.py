"""Modes of the stuck structure and static columns, both with the stored factor."""
