import meshio
import numpy as np

length, width, thickness = 0.2, 0.02, 0.004  # of one leaf [m]
n_x, n_y, n_z = 40, 4, 2  # elements along each of them


def leaf(z_low):
    """Return the nodes of a leaf above z_low, and their numbers in a grid."""
    x = np.linspace(0.0, length, n_x + 1)
    y = np.linspace(0.0, width, n_y + 1)
    z = np.linspace(z_low, z_low + thickness, n_z + 1)
    nodes = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return nodes, np.arange(len(nodes)).reshape(n_x + 1, n_y + 1, n_z + 1)


def faces(layer):
    """Return the four-node faces of a layer of node numbers."""
    around = [layer[:-1, :-1], layer[1:, :-1], layer[1:, 1:], layer[:-1, 1:]]
    return np.stack(around, axis=-1).reshape(-1, 4)


def bricks(grid):
    """Return the eight-node elements of a grid of node numbers."""
    layers = [faces(grid[:, :, k]) for k in range(n_z + 1)]
    return np.concatenate([np.hstack(pair) for pair in zip(layers, layers[1:])])


below, lower = leaf(-thickness)
above, upper = leaf(0.0)
upper += len(below)  # nodes of its own, at the same places on the contact

groups = {
    "lower": ("hexahedron", bricks(lower)),
    "upper": ("hexahedron", bricks(upper)),
    "lower_top": ("quad", faces(lower[:, :, -1])),
    "upper_bottom": ("quad", faces(upper[:, :, 0])),
    "clamp": ("quad", np.concatenate([faces(lower[0]), faces(upper[0])])),
}
dimension = {"hexahedron": 3, "quad": 2}
names, tags = {}, []
for tag, (name, (kind, cells)) in enumerate(groups.items(), start=1):
    names[name] = np.array([tag, dimension[kind]])
    tags.append(np.full(len(cells), tag))

mesh = meshio.Mesh(
    np.concatenate([below, above]),
    list(groups.values()),
    cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
    field_data=names,
)
mesh.write("leaves.msh", file_format="gmsh22")
print(f"{len(mesh.points)} nodes, {lower[:, :, -1].size} contact pairs")
