"""What every room may use, no physics: agreement between ranks, errors, the end of a run, files, signals, memory, words."""
