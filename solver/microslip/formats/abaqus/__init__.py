"""Input files of Abaqus and CalculiX (.inp), read whole: mesh, materials, supports, connections, contact, what acts at rest."""
