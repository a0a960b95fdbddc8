"""Statics: contact at rest under constant loads."""
