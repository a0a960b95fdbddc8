"""The mesh: reading, contact pairs with their frames and areas, parts, partition over the ranks."""
