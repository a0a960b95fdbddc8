"""Shape functions, quadrature, element stiffness and mass of isotropic solids, element faces.  NumPy only.

- ``KINDS[kind]``: ``n_nodes``, ``n_corners``, ``faces`` (tuple of (face kind, local nodes), outward), for "hex8", "hex20",
  "tet4", "tet10", "wedge6", "wedge15"; ``FACE_KINDS[kind]``: ``n_nodes``, ``n_corners`` for "quad4", "quad8", "tri3", "tri6".
  Nodes in the order that VTK, meshio and Abaqus share.
- ``INTEGRATIONS``: the names of the quadrature rules and what they are.
- ``stiffness(kind, points, young, poisson, integration="full", incompatible_modes=True)`` -> (n_e, 3 n, 3 n), DOF node-major
- ``mass(kind, points, density, integration="full")`` -> (n_e, n, n): the same in x, y and z, so the caller expands it
- ``jacobian_minimum(kind, points, integration="full")`` -> (n_e,)
- ``face_normals(kind, points)`` -> (n_f, n, 3) unit outward normals at the nodes;
  ``face_nodal_areas(kind, points)`` -> (n_f, n) positive, their sum over a face is its area
"""
