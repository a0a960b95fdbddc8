"""Readers of Abaqus and CalculiX input files (.inp): mesh, materials, supports, connections, contact, loads at rest."""
