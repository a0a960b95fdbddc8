"""What a run keeps on disk as it goes, and how the same command goes on from it."""
