"""Studies of a scene beside its run: methods compared, time integration, speed against accuracy, batches."""
