"""From elements, or given matrices, to K, M and the sparse maps of pairs, loads and outputs."""
