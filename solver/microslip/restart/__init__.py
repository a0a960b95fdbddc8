"""What a run keeps on disk as it goes, how the same command goes on from it, and what runs of one structure share."""
