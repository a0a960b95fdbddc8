"""Speed against accuracy, each setting measured against a reference that is known."""
