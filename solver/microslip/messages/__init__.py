"""Errors with their exit status, and helpers for the text of messages."""
