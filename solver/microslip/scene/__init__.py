"""The scene file: its keys, their limits, and one message for each mistake in it."""
