"""The command `diff`: comparison of two results by inputs and curves, with a verdict."""
