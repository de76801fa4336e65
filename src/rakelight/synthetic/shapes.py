"""Objects with exactly known depth and normals.

The analytic ones are solids of about 0.3 m at 0.8 m, with relief of a few tenths of a millimetre
to three millimetres at wavelengths of 8 to 60 pixels: plain to see under raking light, and lost
in the noise of a depth sensor.
"""

# numpy types arithmetic on arrays of either real or complex numbers as Any.
# mypy: disable-error-code="no-any-return"

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from rakelight.errors import InputError
from rakelight.model import Camera, Floats
from rakelight.synthetic.implicit import Solid, Surface, Values, trace

VIEW = Camera(width=480, height=360, fx=900.0, fy=900.0, cx=239.5, cy=179.5)
"""The camera that the analytic shapes are made for: one pixel is 0.9 mm on the object."""
DISTANCE_M = 0.8


@dataclass(frozen=True)
class Shape:
    """An object in front of the camera.

    camera : a view that it fills
    render : render(camera, rows), its surface as a camera at the same place sees it, whatever the
        resolution, in these rows of the image; all of them where none are named
    solid : the object itself, where it can be looked at from other places too
    """

    name: str
    camera: Camera
    render: Callable[..., Surface]
    solid: Solid | None = None


def make_shape(name: str) -> Shape:
    """The analytic shape of that name: one of `SHAPES`.

    Raises InputError for another name.

    >>> make_shape("sphere").render(VIEW.scaled(0.1)).depth[17, 23].round(2).item()
    0.7
    """
    if name not in SHAPES:
        raise InputError(
            "no such shape", source="shape", seen=name, needed="one of " + ", ".join(SHAPES)
        )
    return Shape(name, VIEW, partial(trace, SHAPES[name]), SHAPES[name])


# ---- arithmetic that is analytic, so that it carries complex steps


def _analytic(x: Values, value: Floats, slope: Callable[[], Floats]) -> Values:
    """A function's value at x, of its value and slope at x.real: far cheaper than NumPy's own."""
    if x.dtype.kind != "c":
        return value
    both = np.empty(x.shape, complex)
    both.real, both.imag = value, slope() * x.imag
    return both


def _cos(x: Values) -> Values:
    return _analytic(x, np.cos(x.real), lambda: -np.sin(x.real))


def _sin(x: Values) -> Values:
    return _analytic(x, np.sin(x.real), lambda: np.cos(x.real))


def _length(*components: Values) -> Values:
    square: Values = np.asarray(sum(component**2 for component in components))
    # where it is zero, which has no slope, the complex step's own square is below that
    root = np.sqrt(np.maximum(square.real, np.finfo(float).tiny))
    return _analytic(square, root, lambda: 0.5 / root)


def _azimuth(x: Values, y: Values) -> Values:
    """Angle of (x, y), with the derivative that np.arctan2 refuses to give."""
    angle = np.arctan2(y.real, x.real)
    if not (np.iscomplexobj(x) or np.iscomplexobj(y)):
        return angle
    turn = x.real * y.imag - y.real * x.imag
    return angle + 1j * (turn / (x.real**2 + y.real**2))


def _union(a: Values, b: Values, blend_m: float) -> Values:
    """Smooth minimum with continuous curvature; the seam is rounded over about `blend_m`."""
    lower = np.where(a.real < b.real, a, b)
    overlap = 1 - _magnitude(a - b) / (4 * blend_m)
    overlap = np.where(overlap.real > 0, overlap, 0)
    return lower - 4 / 6 * blend_m * overlap * overlap * overlap


def _intersection(a: Values, b: Values, blend_m: float) -> Values:
    return -_union(-a, -b, blend_m)


def _magnitude(x: Values) -> Values:
    return np.where(x.real < 0, -x, x)


def _bump(x: Values, width: float) -> Values:
    """1 at zero, Gaussian."""
    value = np.exp(-((x.real / width) ** 2))
    return _analytic(x, value, lambda: -2 / width**2 * x.real * value)


def _step(x: Values, width: float) -> Values:
    """0 to 1 around x = 0, over about `width`."""
    edge = np.tanh(2 * x.real / width)
    return _analytic(x, 0.5 + 0.5 * edge, lambda: (1 - edge**2) / width)


def _ellipsoid(
    x: Values,
    y: Values,
    z: Values,
    centre: tuple[float, float, float],
    radii: tuple[float, float, float],
) -> Values:
    """About the signed distance to an ellipsoid (exact for a sphere)."""
    u, v, w = ((q - c) / r for q, c, r in zip((x, y, z), centre, radii, strict=True))
    near = _length(u, v, w)
    return near * (near - 1) / _length(u / radii[0], v / radii[1], w / radii[2])


# ---- the objects: functions of (right, up, front) in metres from the centre


def _sphere(x: Values, y: Values, z: Values) -> Values:
    return _length(x, y, z) - 0.1


def _vase(x: Values, y: Values, z: Values) -> Values:
    """An amphora with gadroons, a frieze of rosettes between beads, and a fluted neck."""
    radius, angle = _length(x, z), _azimuth(z, x)
    profile = (
        0.030
        + 0.052 * _bump(y - 0.020, 0.062)
        + 0.016 * _bump(y + 0.045, 0.045)
        + 0.012 * _bump(y + 0.145, 0.016)
        + 0.020 * _step(y - 0.135, 0.030)
        + 0.0040 * _bump(y + 0.118, 0.005)
        + 0.0035 * _bump(y - 0.098, 0.004)
    )
    ribs = 0.5 + 0.5 * _cos(22 * angle)
    gadroons = 0.0030 * ribs * _step(y + 0.095, 0.02) * _step(-0.018 - y, 0.012)
    flutes = 0.0008 * _cos(18 * angle + 90 * y) * _step(y - 0.106, 0.01) * _step(0.134 - y, 0.01)
    bead = 0.0011 * (0.5 + 0.5 * _cos(54 * angle)) + 0.0006
    beads = bead * _bump(y + 0.010, 0.0034) + bead * _bump(y - 0.056, 0.0034)
    collar = 0.0007 * _cos(44 * angle) * _bump(y - 0.074, 0.009)
    relief = gadroons + flutes + beads + collar + _rosettes(angle, y - 0.023)
    wall = (radius - profile - relief) * 0.75
    return _intersection(wall, _magnitude(y) - 0.142, 0.0015)


def _rosettes(angle: Values, y: Values) -> Values:
    """Nine flowers of eight petals around a frieze, 2 mm high, with leaves between them."""
    count, wall_m = 9, 0.082
    # the angle within one flower, as a length along the wall; the seams are flat
    place = np.round(angle.real * count / (2 * np.pi)) * 2 * np.pi / count
    x = wall_m * (angle - place)
    r, spoke = _length(x, y), _azimuth(x, y)
    petal = _cos(4 * spoke) ** 2
    petals = 0.0024 * petal * _bump(r - 0.0125, 0.0065) + 0.0009 * _bump(r - 0.0215, 0.0025)
    heart = 0.0026 * _bump(r, 0.0046)
    side = _magnitude(x) - wall_m * np.pi / count
    leaves = 0.0017 * _bump(side, 0.0030) * _bump(y, 0.017) * (0.6 + 0.4 * _cos(700 * y))
    return petals + heart + leaves


def _cloth(x: Values, y: Values, z: Values) -> Values:
    """A cloth that hangs from two pins: fans of folds, swags between, fine creases."""
    left_r, left = _length(x + 0.150, y - 0.200), _azimuth(0.200 - y, x + 0.150)
    right_r, right = _length(x - 0.165, y - 0.205), _azimuth(0.205 - y, 0.165 - x)
    wander = _sin(17 * y + 11 * x)
    from_left = 0.044 * left_r * np.exp(1.2 * _cos(25 * left + 0.8 * wander) - 1.2)
    from_right = 0.046 * right_r * np.exp(1.2 * _cos(23 * right + 0.9 * wander + 2.2) - 1.2)
    slack = left_r + right_r + 0.012 * _sin(26 * x + 1) + 0.006 * _sin(60 * y)
    swags = 0.0105 * np.exp(1.4 * _cos(2 * np.pi * slack / 0.085) - 1.4)
    folds = -_union(_union(-from_left, -from_right, 0.003), -swags, 0.003)
    belly = 0.022 * _bump(y + 0.02, 0.10) * _bump(x, 0.13)
    creases = 0.0006 * _sin(190 * (0.8 * x + y) + 3 * _sin(31 * y + 20 * x)) * (1 + wander)
    ripples = 0.0004 * _sin(330 * (0.45 * x - y) + 3 * _sin(40 * x)) * (1 - wander)
    weave = _sin(870 * (x + 0.3 * y)) * _sin(870 * (y - 0.3 * x))
    front = z - (folds + belly + creases + ripples + 0.0001 * weave - 0.015)
    edge = np.maximum(
        _magnitude(x + 0.004 * _sin(38 * y)).real - 0.150,
        _magnitude(y + 0.006 * _sin(21 * x) + 0.002 * _sin(60 * x + 1)).real - 0.130,
    )
    return np.where(edge > 0, edge + 1e-4, 0.6 * front)


def _coin(x: Values, y: Values, z: Values) -> Values:
    """A medal, tilted: rim, beads, a laurel wreath, and a sun with a spiral face."""
    x, y, z = _turned(x, y, z, tilt=0.16, turn=-0.22)
    r, angle = _length(x, y), _azimuth(x, y)
    rim = 0.0035 * _step(r - 0.123, 0.006)
    beads = 0.0018 * (0.5 + 0.5 * _cos(60 * angle)) * _bump(r - 0.1135, 0.0036)
    lean = angle + 11 * (r - 0.093)
    leaf = 0.5 + 0.5 * _cos(24 * lean)
    veins = 0.00012 * _cos(96 * lean)
    wreath = (0.0026 * leaf + veins) * _bump(r - 0.0930, 0.0090)
    long_rays = (0.5 + 0.5 * _cos(12 * angle)) ** 2 * _bump(r - 0.055, 0.0195)
    short_rays = (0.5 - 0.5 * _cos(12 * angle)) ** 2 * _bump(r - 0.046, 0.0105)
    dome = 0.0030 * _step(0.033 - r, 0.005) + 0.0025 * _bump(r, 0.021)
    spiral = 0.0008 * _cos(5 * angle + 520 * r) * _bump(r - 0.019, 0.0085)
    rings = 0.00010 * _cos(2 * np.pi * r / 0.0075) * _step(r - 0.045, 0.02)
    relief = rim + beads + wreath + 0.0026 * long_rays + 0.0018 * short_rays + dome + spiral + rings
    face = 0.7 * (z - 0.004 - relief)
    edge = _intersection(r - 0.132, -0.006 - z, 0.0012)
    return _intersection(face, edge, 0.0012)


def _turned(
    x: Values, y: Values, z: Values, tilt: float, turn: float
) -> tuple[Values, Values, Values]:
    """Coordinates of an object that is tilted backwards and turned to its left (radians)."""
    y, z = y * np.cos(tilt) + z * np.sin(tilt), z * np.cos(tilt) - y * np.sin(tilt)
    x, z = x * np.cos(turn) + z * np.sin(turn), z * np.cos(turn) - x * np.sin(turn)
    return x, y, z


def _head(x: Values, y: Values, z: Values) -> Values:
    """A bust: curly head, neck, draped shoulders, on a turned pedestal."""
    large = 1.22
    face = large * _face(*_turned(x / large, 0.142 + (y - 0.148) / large, z / large, 0.03, 0.30))
    return _union(_union(face, _shoulders(x, y, z), 0.0025), _pedestal(x, y, z), 0.0015)


def _face(x: Values, y: Values, z: Values) -> Values:
    """A head of 0.11 m: skull and jaw, then the parts that lie on them, then carving and hair."""
    side = _magnitude(x)
    head = _union(
        _ellipsoid(x, y, z, (0, 0.092, -0.004), (0.0395, 0.0480, 0.0490)),
        _ellipsoid(x, y, z, (0, 0.062, 0.011), (0.0305, 0.0350, 0.0320)),
        0.0045,
    )
    sockets = _bump(side - 0.0142, 0.0105) * _bump(y - 0.0830, 0.0072) * _step(z, 0.01)
    hollows = _bump(side - 0.0400, 0.012) * _bump(y - 0.0560, 0.010) * _step(z, 0.01)
    head = head + 0.0066 * sockets + 0.0020 * hollows
    bridge = z + 0.42 * (y - 0.078)
    arch = y + 16 * (side - 0.0140) ** 2
    smile = y - 3 * x**2
    for part, blend_m in (
        (_ellipsoid(side, y, z, (0.0185, 0.0690, 0.0265), (0.0110, 0.0120, 0.0110)), 0.0040),
        (_ellipsoid(side, arch, z, (0.0138, 0.0940, 0.0365), (0.0125, 0.0032, 0.0058)), 0.0028),
        (_ellipsoid(x, y, z, (0, 0.0350, 0.0330), (0.0115, 0.0080, 0.0085)), 0.0035),
        (_ellipsoid(x, y, bridge, (0, 0.0790, 0.0455), (0.0042, 0.0150, 0.0078)), 0.0018),
        (_ellipsoid(x, y, z, (0, 0.0675, 0.0520), (0.0054, 0.0048, 0.0060)), 0.0014),
        (_ellipsoid(side, y, z, (0.0056, 0.0668, 0.0460), (0.0034, 0.0038, 0.0050)), 0.0010),
        (_ellipsoid(side, y, z, (0.0142, 0.0832, 0.0312), (0.0080, 0.0064, 0.0076)), 0.0005),
        (_ellipsoid(x, smile + 6 * x**2, z, (0, 0.0530, 0.0402), (0.0105, 0.0024, 0.0046)), 0.0010),
        (_ellipsoid(x, smile, z, (0, 0.0480, 0.0398), (0.0085, 0.0028, 0.0050)), 0.0010),
        (_ellipsoid(side, y - 0.2 * z, z, (0.040, 0.0770, -0.004), (0.0050, 0.0150, 0.0095)), 8e-4),
    ):
        head = _union(head, part, blend_m)
    lids = _bump(y - 0.0866 + 26 * (side - 0.0142) ** 2, 0.0011) * _bump(side - 0.0142, 0.0085)
    wrinkles = _cos(2 * np.pi * (y + 5 * x**2) / 0.0066) * _bump(y - 0.1060, 0.0080)
    groove = _bump(side - 0.0150 + 0.35 * (y - 0.056), 0.0022) * _bump(y - 0.0585, 0.0060)
    ear = (
        _bump(y - 0.2 * z - 0.0790, 0.0085) * _bump(z + 0.0040, 0.0050) * _step(side - 0.042, 0.003)
    )
    carving = 0.0008 * lids + 0.0003 * wrinkles * _bump(x, 0.022) - 0.0010 * groove
    return (head - carving * _step(z - 0.02, 0.01) + 0.0025 * ear - _hair(x, y, z)) * 0.9


def _hair(x: Values, y: Values, z: Values) -> Values:
    """Height of the hair in metres: locks combed back from a hairline over brow and ears."""
    above = y - 0.119 + 1.15 * (0.034 - z) + 0.0016 * _sin(300 * x + 60 * z)
    cap = _step(above, 0.005)
    flow = 1.2 * _sin(80 * z + 40 * y) + 0.8 * _sin(130 * z - 60 * x + 1)
    around = _azimuth(y - 0.080, x) + 0.25 * _sin(34 * z)
    locks = 0.5 + 0.5 * _cos(28 * around + flow)
    strands = _cos(70 * around + 2 * flow + 1.0)
    return cap * (0.0022 + 0.0017 * locks + 0.0003 * strands)


def _shoulders(x: Values, y: Values, z: Values) -> Values:
    neck = _length(x, z + 0.004 - 0.18 * (y - 0.02)) - 0.0255 - 0.010 * _step(0.004 - y, 0.03)
    neck = _intersection(neck, _magnitude(y - 0.015) - 0.040, 0.004)
    chest = _ellipsoid(x, y, z, (0, -0.047, -0.012), (0.0940, 0.0500, 0.0420))
    breast = _ellipsoid(x, y, z, (0, -0.058, 0.006), (0.0660, 0.0400, 0.0330))
    torso = _union(chest, breast, 0.006)
    # a toga: folds that run from the left shoulder to the right side
    fall = 0.62 * x + y + 5.0 * x**2
    drape = _step(-0.012 - 0.45 * x - y + 0.02 * _sin(30 * x), 0.010)
    folds = 0.0026 * _sin(300 * fall + 1.2 * _sin(40 * x)) + 0.0007 * _sin(
        660 * fall + 2 * _sin(55 * x) + 1
    )
    torso = torso - drape * (0.0030 + folds)
    body = _union(torso, neck, 0.006)
    # the bust is cut below in an arch
    cut = -0.086 + 6.0 * x**2 - y
    return _intersection(body, cut * 0.6, 0.0020) * 0.8


def _pedestal(x: Values, y: Values, z: Values) -> Values:
    radius, angle = _length(x, z + 0.008), _azimuth(z + 0.008, x)
    profile = (
        0.0230
        + 0.0200 * _step(-0.128 - y, 0.008)
        + 0.0060 * _bump(y + 0.120, 0.005)
        + 0.0090 * _bump(y + 0.084, 0.008)
        + 0.0008 * _cos(16 * angle) * _bump(y + 0.103, 0.010)
    )
    column = (radius - profile) * 0.6
    slab = _magnitude(y + 0.110) - 0.034
    return _intersection(column, slab, 0.0012)


SHAPES: dict[str, Solid] = {
    "head": Solid(_head, DISTANCE_M, radius_m=0.180, steepness=1.35),
    "vase": Solid(_vase, DISTANCE_M, radius_m=0.180, steepness=1.2),
    "cloth": Solid(_cloth, DISTANCE_M, radius_m=0.235, steepness=1.0),
    "coin": Solid(_coin, DISTANCE_M, radius_m=0.140, steepness=1.0),
    "sphere": Solid(_sphere, DISTANCE_M, radius_m=0.101),
}
