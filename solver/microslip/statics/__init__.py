"""Statics: contact at rest under constant loads, in load steps."""
