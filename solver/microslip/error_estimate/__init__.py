"""What is wrong with a converged point, estimated from the point itself: a bar on the response it reports."""
