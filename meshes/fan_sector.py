"""Generate a fan-blade sector: twisted, tapered blade, curved dovetail with two flanks, sector of a disc; hex20.

    python meshes/fan_sector.py --size small --out meshes/fan_small.msh

Axes: x along the circumference, y along the engine's axis, z outwards; the aerofoil starts at z = 0 on the stacking
line x = y = 0.  The engine's axis is parallel to y.  Blade and disc are two bodies.  Their nodes coincide on the two
flanks ("blade_root", "disc_slot") without being shared; everywhere else there is a clearance between the bodies.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from blocks import Body, block, jacobian_minimum, join
from generator import add_options, named, option, parser_of, write


@dataclass(frozen=True)
class Shape:
    """Geometry; lengths in m, angles in degrees."""

    length: float = option(0.260, "aerofoil, platform level to tip")
    chord_root: float = option(0.070, "chord at the platform level")
    chord_tip: float = option(0.060, "chord at the tip")
    thickness_root: float = option(0.0080, "largest thickness at the platform level")
    thickness_tip: float = option(0.0040, "largest thickness at the tip")
    edge: float = option(0.4, "thickness of the leading and trailing edge over the largest thickness")
    camber_root: float = option(0.05, "sag of the camber line over the chord, at the platform level")
    camber_tip: float = option(0.03, "the same at the tip")
    twist: float = option(35.0, "turn of the chord from the platform level (along the engine's axis) to the tip")
    flare: float = option(0.010, "height of the transition from the aerofoil to the neck of the dovetail")
    neck_width: float = option(0.0160, "width of the neck at the rim")
    neck_height: float = option(0.0060, "from the rim to the upper edge of the flanks")
    throat_width: float = option(0.0140, "width of the dovetail at the upper edge of the flanks")
    flank_width: float = option(0.0090, "width of a flank, from its upper to its lower edge")
    flank_angle: float = option(45.0, "between a flank and the radius")
    flank_crown: float = option(0.00010, "sag of a flank across its width: the blade's is convex, the slot's concave")
    lobe_height: float = option(0.0045, "of the dovetail below the flanks")
    root_length: float = option(0.066, "of dovetail and disc along the engine's axis")
    arc_radius: float = option(0.160, "radius of the arc along which dovetail and slot are swept")
    clearance: float = option(0.0012, "between dovetail and slot at the rim and at the bottom")
    n_blades: int = option(20, "blades on the disc: the sector is 360 degrees over this")
    rim_radius: float = option(0.160, "outer radius of the disc")
    bore_radius: float = option(0.100, "inner radius of the disc, where it is fixed")

    def __post_init__(self):
        signed = ("camber_root", "camber_tip", "twist", "flank_crown")
        bad = [item.name for item in fields(self) if item.name not in signed and not getattr(self, item.name) > 0]
        if bad:
            raise ValueError(f"{', '.join(bad)} must be positive")
        if self.arc_radius < self.root_length:
            raise ValueError(f"arc_radius must not be less than root_length = {self.root_length} m")


@dataclass(frozen=True)
class Divisions:
    """Numbers of elements."""

    span: int = option(0, "aerofoil, root to tip")
    chord: int = option(0, "chord of the aerofoil, and length of dovetail and disc along the engine's axis")
    thickness: int = option(0, "aerofoil, neck and dovetail, side to side")
    fillet: int = option(0, "height of the transition from aerofoil to neck")
    neck: int = option(0, "height of the neck, and of the slot's wall beside it")
    flank: int = option(0, "width of a flank")
    lobe: int = option(0, "height of the dovetail below the throat")
    wall: int = option(0, "height of the slot's wall below the flank")
    post: int = option(0, "disc, from slot to cyclic face")
    slot: int = option(0, "disc, across the slot's bottom")
    ring: int = option(0, "disc, from the slot's bottom to the bore")


SIZES = {
    "small": Divisions(span=32, chord=4, thickness=2, fillet=2, neck=1, flank=1, lobe=2, wall=1, post=3, slot=3, ring=4),
    "medium": Divisions(span=54, chord=8, thickness=3, fillet=3, neck=2, flank=2, lobe=3, wall=2, post=5, slot=4, ring=5),
    "paper": Divisions(span=88, chord=13, thickness=4, fillet=4, neck=3, flank=2, lobe=5, wall=3, post=6, slot=6, ring=7),
}


class _Geometry:
    """Points and curves of a ``Shape`` in sections of constant y: arrays (2, n) of x and z [m]; y is (n,) everywhere.

    A profile (s, z) is swept: s runs along the radii of the dovetail's arc, so each s is a cylinder and the blade can
    be inserted along the arc.  ``side`` is +1 or -1.
    """

    def __init__(self, shape: Shape):
        self.shape = shape
        angle = np.radians(shape.flank_angle)
        self.axis_z = -shape.flare - shape.rim_radius  # height of the engine's axis
        self.neck = np.array([shape.neck_width / 2.0, -shape.flare])
        self.upper = np.array([shape.throat_width / 2.0, self.neck[1] - shape.neck_height])  # edges of the flank
        self.lower = self.upper + shape.flank_width * np.array([np.sin(angle), -np.cos(angle)])
        self.heel = self.lower - shape.lobe_height * np.array([0.2, 1.0])  # lower corner of the dovetail
        self.foot = np.array([0.6 * self.upper[0], self.heel[1]])  # lower end of the column in its middle
        self.floor = np.array([self.lower[0] + shape.clearance, self.heel[1] - shape.clearance])  # corner of the slot

    def swept(self, point, y, side=1):
        """Return the profile's point(s) (s, z) in the section at y."""
        radius = self.shape.arc_radius
        shift = self.shape.camber_root * self.shape.chord_root / 3.0  # puts the middle of the root on x = 0
        x = np.sqrt((radius + side * point[0]) ** 2 - y**2) - radius + shift
        return np.stack(np.broadcast_arrays(x, point[1]))

    def edge(self, start, end, side=1):
        """Return the straight edge of the profile from one point (s, z) to another."""
        return lambda t, y: self.swept([a + (b - a) * t for a, b in zip(start, end, strict=True)], y, side)

    def flank(self, side):
        """Return the flank from its lower to its upper edge, the same curve for both bodies."""
        along = self.upper - self.lower
        outward = np.array([along[1], -along[0]]) / np.linalg.norm(along)  # out of the blade

        def curve(t, y):
            bulge = 4.0 * self.shape.flank_crown * t * (1.0 - t)
            return self.swept([self.lower[i] + along[i] * t + outward[i] * bulge for i in (0, 1)], y, side)

        return curve

    def on_circle(self, radius, angle):
        """Return the point at ``radius`` and ``angle`` [rad] about the engine's axis."""
        return np.stack(np.broadcast_arrays(radius * np.sin(angle), self.axis_z + radius * np.cos(angle)))

    def angle(self, point, y, side):
        """Return the angle [rad] about the engine's axis of a point of the profile."""
        x, z = self.swept(point, y, side)
        return np.arctan2(x, z - self.axis_z)

    def cyclic_angle(self, y, side):
        """Return the angle [rad] of a cyclic face: it follows the dovetail's arc, and the next sector fits to it."""
        return side * np.pi / self.shape.n_blades + self.swept((0.0, 0.0), y)[0] / self.shape.rim_radius

    def rim_corner(self, y, side):
        """Return the upper corner of the slot, on the rim."""
        return self.on_circle(self.shape.rim_radius, self.rim_angle(y, side))

    def rim_angle(self, y, side):
        """Return the angle [rad] of the upper corner of the slot."""
        return np.arcsin(self.swept((self.neck[0] + self.shape.clearance, 0.0), y, side)[0] / self.shape.rim_radius)

    def below_floor(self, side):
        """Return the radial line from the bore to a lower corner of the slot."""
        return _straight(
            lambda y: self.on_circle(self.shape.bore_radius, self.angle(self.floor, y, side)),
            lambda y: self.swept(self.floor, y, side),
        )

    def arc(self, radius, start, end):
        """Return the arc between two angles, given as functions of y."""
        return lambda t, y: self.on_circle(radius, start(y) + (end(y) - start(y)) * t)


def fan_sector(shape: Shape, divisions: Divisions) -> dict[str, Body]:
    """Return the bodies "blade" and "disc".  Local.

    Raises
    ------
    ValueError: the parameters turn elements inside out.
    """
    geometry = _Geometry(shape)
    bodies = {"blade": _blade(geometry, divisions), "disc": _disc(geometry, divisions)}
    for name, body in bodies.items():
        n_bad = np.count_nonzero(~(jacobian_minimum(body) > 0.0))
        if n_bad:
            raise ValueError(f"these parameters turn {n_bad} of {len(body.elements)} elements of the {name} inside out")
    return bodies


def _blade(geometry: _Geometry, n: Divisions) -> Body:
    """Return aerofoil, transition, neck and dovetail as one body."""
    shape, neck, upper, lower = geometry.shape, geometry.neck, geometry.upper, geometry.lower
    heel, foot = geometry.heel, geometry.foot

    def aerofoil(u, v, w):
        return np.column_stack([*_aerofoil(shape, 2.0 * u - 1.0, 2.0 * v - 1.0, w), w * shape.length])

    def transition(u, v, w):  # a parabola that leaves the aerofoil without a kink
        at_top = np.column_stack(_aerofoil(shape, 2.0 * u - 1.0, 2.0 * v - 1.0, 0.0))
        y = (v - 0.5) * shape.root_length
        at_neck = np.column_stack([geometry.swept(((2.0 * u - 1.0) * neck[0], neck[1]), y)[0], y])
        share = (1.0 - (1.0 - w) ** 2)[:, None]
        return np.column_stack([at_neck + share * (at_top - at_neck), (w - 1.0) * shape.flare])

    def column(low, high):  # a symmetric trapezium of the profile
        def section(u, v, y):
            half, z = (low[i] + (high[i] - low[i]) * v for i in (0, 1))
            return geometry.swept(((2.0 * u - 1.0) * half, z), y)

        return section

    parts = [
        block("hex20", aerofoil, (n.thickness, n.chord, n.span), {"z1": "blade_tip"}),
        block("hex20", transition, (n.thickness, n.chord, n.fillet)),
        _extruded(shape, column(upper, neck), (n.thickness, n.chord, n.neck)),
        _extruded(shape, column(foot, upper), (n.thickness, n.chord, n.lobe)),
    ]
    for side in (-1, 1):
        wing = _coons(
            geometry.edge(foot, heel, side),
            _reversed(geometry.flank(side)),
            geometry.edge(foot, upper, side),
            geometry.edge(heel, lower, side),
        )
        parts.append(_extruded(shape, wing, (n.flank, n.chord, n.lobe), {"z1": "blade_root"}, side))
    return join(parts)


def _aerofoil(shape: Shape, across, along, height) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y [m] of the aerofoil; across and along in [-1, 1], height in [0, 1]."""

    def taper(root, tip):
        return root + (tip - root) * height

    chord = taper(shape.chord_root, shape.chord_tip)
    thickness = taper(shape.thickness_root, shape.thickness_tip) * (shape.edge + (1.0 - shape.edge) * (1.0 - along**2))
    camber = taper(shape.camber_root, shape.camber_tip) * chord * (1.0 / 3.0 - along**2)
    x, y = camber + across * thickness / 2.0, along * chord / 2.0
    turn = np.radians(shape.twist) * height
    return x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)


def _disc(geometry: _Geometry, n: Divisions) -> Body:
    """Return the sector of the disc as one body: the posts on both sides of the slot, and the ring under the slot."""
    shape, floor = geometry.shape, geometry.floor
    parts = [part for side in (-1, 1) for part in _post(geometry, n, side)]
    angles = [lambda y, side=side: geometry.angle(floor, y, side) for side in (-1, 1)]
    ring = _coons(
        geometry.arc(shape.bore_radius, *angles),
        geometry.edge(floor * [-1, 1], floor),
        geometry.below_floor(-1),
        geometry.below_floor(1),
    )
    parts.append(_extruded(shape, ring, (n.slot, n.chord, n.ring), {"z0": "disc_base"}))
    return join(parts)


def _post(geometry: _Geometry, n: Divisions, side: int) -> list[Body]:
    """Return the disc beside the slot: strips along the slot's neck, flank and lower wall, and the ring below."""
    shape, floor, lower, upper = geometry.shape, geometry.floor, geometry.lower, geometry.upper

    def at_wall(point):
        return lambda y: geometry.swept(point, y, side)

    def at_cyclic(level):
        return lambda y: geometry.on_circle(level - geometry.axis_z, geometry.cyclic_angle(y, side))

    def cyclic_angle(y):
        return geometry.cyclic_angle(y, side)

    bore = geometry.axis_z + shape.bore_radius
    levels = [geometry.neck[1], upper[1], lower[1], floor[1], bore]  # of the ends of the strips
    walls = [
        _straight(at_wall(upper), lambda y: geometry.rim_corner(y, side)),
        geometry.flank(side),
        geometry.edge(floor, lower, side),
        geometry.below_floor(side),
    ]
    across = [geometry.arc(shape.rim_radius, lambda y: geometry.rim_angle(y, side), cyclic_angle)]
    across += [_straight(at_wall(point), at_cyclic(point[1])) for point in (upper, lower, floor)]
    across += [geometry.arc(shape.bore_radius, lambda y: geometry.angle(floor, y, side), cyclic_angle)]
    extra = [{"z1": "disc_rim"}, {"x0": "disc_slot"}, {}, {"z0": "disc_base"}]
    cyclic = {"x1": "disc_cyclic_high" if side > 0 else "disc_cyclic_low"}
    parts = []
    for i, n_height in enumerate((n.neck, n.flank, n.wall, n.ring)):
        strip = _coons(across[i + 1], across[i], walls[i], _straight(at_cyclic(levels[i + 1]), at_cyclic(levels[i])))
        parts.append(_extruded(shape, strip, (n.post, n.chord, n_height), {**cyclic, **extra[i]}, side))
    return parts


def _straight(start, end):
    """Return the straight line between two points, given as functions of y."""
    return lambda t, y: start(y) + (end(y) - start(y)) * t


def _reversed(curve):
    return lambda t, y: curve(1.0 - t, y)


def _coons(low, high, left, right):
    """Return the section's map (u, v, y) -> (x, z) between the curves low and high along u, left and right along v."""

    def section(u, v, y):
        corners = (1.0 - u) * ((1.0 - v) * low(0.0, y) + v * high(0.0, y)) + u * ((1.0 - v) * low(1.0, y) + v * high(1.0, y))
        return (1.0 - v) * low(u, y) + v * high(u, y) + (1.0 - u) * left(v, y) + u * right(v, y) - corners

    return section


def _extruded(shape: Shape, section, divisions, names=None, side: int = 1) -> Body:
    """Return the block of a section's map along y; a mirrored section (side = -1) is swept backwards, to keep det J positive."""

    def mapping(u, v, w):
        y = side * (v - 0.5) * shape.root_length
        x, z = section(u, w, y)
        return np.column_stack([x, y, z])

    return block("hex20", mapping, divisions, names)


def main(arguments=None) -> None:
    """Write the requested mesh and print a summary."""
    parser = parser_of(__doc__, "Gmsh format 2.2")
    parser.add_argument("--size", choices=SIZES, default="small", help="element counts")
    parser.add_argument("--ascii", action="store_true", help="write text instead of binary")
    add_options(parser.add_argument_group("geometry: m, degrees"), Shape)
    add_options(parser.add_argument_group("elements: default as for --size"), Divisions, has_defaults=False)
    given = vars(parser.parse_args(arguments))
    divisions = replace(SIZES[given["size"]], **named(given, Divisions))
    write(parser, given, lambda: fan_sector(Shape(**named(given, Shape)), divisions), [("blade_root", "disc_slot")])


if __name__ == "__main__":
    main()
