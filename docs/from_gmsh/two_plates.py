"""Two plates that touch over 80 mm, meshed by Gmsh: the example of docs/from_gmsh.md."""

import gmsh

gmsh.initialize()
gmsh.option.setNumber("Mesh.SaveAll", 0)
occ = gmsh.model.occ
lower = occ.addBox(0.0, 0.0, 0.0, 0.20, 0.03, 0.006)
upper = occ.addBox(0.12, 0.0, 0.006, 0.20, 0.03, 0.006)
occ.synchronize()  # two volumes that touch, and share nothing


def faces_at(volume, axis, value):
    """The faces of a volume that lie in a plane."""
    faces = gmsh.model.getBoundary([(3, volume)], oriented=False)
    return [tag for dim, tag in faces if abs(occ.getCenterOfMass(dim, tag)[axis] - value) < 1e-9]


gmsh.model.addPhysicalGroup(3, [lower], name="lower")
gmsh.model.addPhysicalGroup(3, [upper], name="upper")
gmsh.model.addPhysicalGroup(2, faces_at(lower, 0, 0.0), name="clamp")
gmsh.option.setNumber("Mesh.MeshSizeMax", 0.012)
gmsh.option.setNumber("Mesh.ElementOrder", 2)
gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
gmsh.model.mesh.generate(3)
gmsh.write("two_plates.msh")
