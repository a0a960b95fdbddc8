"""Modes of the stuck structure and static columns, both by the kept factor."""
