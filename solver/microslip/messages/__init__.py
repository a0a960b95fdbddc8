"""What the program says: errors with their exit status, and words for messages."""
