"""The command line and its checks before a computation."""
