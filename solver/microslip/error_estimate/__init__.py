"""Error bars on the response of a converged point, estimated from the point itself."""
