"""From elements to K, M and the sparse maps of the scene."""
