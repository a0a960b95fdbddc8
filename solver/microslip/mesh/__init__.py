"""The mesh: reading, contact pairs with frames and areas, connected parts, partition over the ranks."""
