"""The values that walk through rakelight: camera, capture, lights, result.

Frames and units, everywhere: metres; camera frame with x right, y down, z forward; unit normals
that face the camera (n_z < 0); pixel (u, v) = (column, row) with pixel centres at integers from
0; images indexed [row, column] with channels red, green, blue.  See docs/reference/conventions.md.
Values that hold arrays are equal only to themselves.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from numbers import Integral, Real
from typing import Any, Literal, NoReturn, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from rakelight.errors import InputError

Array: TypeAlias = npt.NDArray[Any]
Floats: TypeAlias = npt.NDArray[np.floating[Any]]
Mask: TypeAlias = npt.NDArray[np.bool_]

T = TypeVar("T")

Encoding = Literal["linear", "srgb"]
LensModel = Literal["brown-conrady", "inverse-brown-conrady", "kannala-brandt"]
Lighting = Literal["moving-lamp", "rgb-leds", "ambient"]

# Standard deviation of Gaussian noise over the median of its absolute deviations.
MAD_TO_SIGMA = 1.4826

# Least divisor where nothing, or next to nothing, may be divided by: its inverse does not overflow.
TINY = 1e-30

# Sensors bend before they clip; below the lower level a pixel holds little but its own offset.
SATURATED = 0.98  # of the largest value
BLACK = 0.004

# Where a distant lamp stands among near ones, metres from the object.
FARTHEST_M = 1e6


def finite_number(value: object) -> bool:
    """Whether it is a number that a float holds: no NaN, no bool, no integer of 400 digits.

    >>> finite_number(3), finite_number(float("nan")), finite_number(10**400)
    (True, False, False)
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        return False
    try:
        return isfinite(float(value))
    except OverflowError:
        return False


# How many coefficients a lens model has.
_COEFFICIENTS: dict[str, tuple[int, ...]] = {
    "brown-conrady": (4, 5, 8),
    "inverse-brown-conrady": (5,),
    "kannala-brandt": (4,),
}


@dataclass(frozen=True, slots=True)
class Distortion:
    """How a lens moves points of the image plane, in units of the focal length.

    So it does not change when the image is cropped or scaled.  The formulas are in
    docs/reference/conventions.md; `rakelight.geometry.distortion` computes them.

    model : "brown-conrady", OpenCV's; "inverse-brown-conrady", librealsense's; "kannala-brandt",
        OpenCV's fisheye
    coefficients : k1 k2 p1 p2 [k3 [k4 k5 k6]] of brown-conrady, in OpenCV's order; k1 k2 p1 p2 k3
        of inverse-brown-conrady; k1 k2 k3 k4 of kannala-brandt

    Raises InputError for an unknown model, another number of coefficients, or values that are not
    finite.

    >>> Distortion("brown-conrady", [0.1, -0.2, 0, 0])
    Distortion(model='brown-conrady', coefficients=(0.1, -0.2, 0.0, 0.0))
    """

    model: LensModel
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        counts = _COEFFICIENTS.get(self.model) if isinstance(self.model, str) else None
        if counts is None:
            raise InputError(
                "an unknown model of lens distortion",
                source="distortion",
                seen=str(self.model)[:80],
                needed=", ".join(_COEFFICIENTS),
                remedy="OpenCV, COLMAP and most calibrations are brown-conrady, fisheye lenses "
                "kannala-brandt",
            )
        given = self.coefficients
        numbers = tuple(given) if isinstance(given, (tuple, list, np.ndarray)) else (given,)
        if not all(map(finite_number, numbers)):
            raise InputError(
                "the coefficients of lens distortion are not finite numbers",
                source="distortion",
                seen=str(given)[:80],
                needed="a sequence of finite numbers",
                remedy="write them down from the calibration",
            )
        if len(numbers) not in counts:
            raise InputError(
                f"another number of coefficients than {self.model} has",
                source="distortion",
                seen=f"{len(numbers)}",
                needed=" or ".join(map(str, counts)),
                remedy="k1 k2 k3 k4"
                if self.model == "kannala-brandt"
                else "k1 k2 p1 p2 k3 in OpenCV's order; 0 for those that there are not",
            )
        object.__setattr__(self, "coefficients", tuple(map(float, numbers)))

    @property
    def is_none(self) -> bool:
        """Whether it leaves every point where it is.

        >>> Distortion("brown-conrady", [0, 0, 0, 0]).is_none
        True
        """
        return self.model != "kannala-brandt" and not any(self.coefficients)


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera: image size and intrinsics in pixels, pixel centres at integers from 0.

    distortion : of its lens; None where there is none, or it was taken out of the images

    >>> Camera(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5).shape
    (480, 640)
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Distortion | None = None

    def __post_init__(self) -> None:
        """Numbers of NumPy and of other kinds become Python's, as JSON and solvers take them."""
        for name in ("width", "height", "fx", "fy", "cx", "cy"):
            value = getattr(self, name)
            if finite_number(value):
                plain = int(value) if isinstance(value, Integral) else float(value)
                object.__setattr__(self, name, plain)

    @classmethod
    def from_matrix(
        cls,
        K: Array,
        shape: tuple[int, int],
        distortion: Distortion | Sequence[float] | Array | None = None,
    ) -> Camera:
        """The camera of a calibration matrix.

        K : (3, 3) pixels, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], for pixel centres at integers
            from 0, as OpenCV and ROS write it
        shape : (height, width) of the images in pixels, numpy's order
        distortion : of the lens; None for images without.  Bare numbers are those of Brown and
            Conrady's model in OpenCV's order, as cv2.calibrateCamera returns them

        Raises InputError where K is no such matrix (skew, other numbers than these, focal lengths
        that are not positive), the shape is not two positive whole numbers, or the distortion is
        none that `Distortion` takes.

        >>> K = np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]])
        >>> Camera.from_matrix(K, (480, 640))
        Camera(width=640, height=480, fx=525.0, fy=525.0, cx=319.5, cy=239.5, distortion=None)
        >>> Camera.from_matrix(K, (480, 640), [0.1, -0.2, 0.0, 0.0, 0.0]).distortion.model
        'brown-conrady'
        """
        height, width = _image_shape(shape)
        fx, fy, cx, cy = _intrinsics(K)
        lens = _distortion(distortion)
        camera = cls(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy, distortion=lens)
        _refuse_exchanged_sides(camera)
        return camera

    @property
    def matrix(self) -> Floats:
        """(3, 3) float64 [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.

        >>> Camera(640, 480, 525.0, 520.0, 319.5, 239.5).matrix.tolist()
        [[525.0, 0.0, 319.5], [0.0, 520.0, 239.5], [0.0, 0.0, 1.0]]
        """
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), the shape of an image of this camera."""
        return self.height, self.width

    def scaled(self, factor: float) -> Camera:
        """The same view with `factor` times as many pixels along each side.

        >>> Camera(640, 480, 500.0, 500.0, 319.5, 239.5).scaled(2)
        Camera(width=1280, height=960, fx=1000.0, fy=1000.0, cx=639.5, cy=479.5, distortion=None)

        Raises InputError where it is no number above 0.
        """
        if not finite_number(factor) or factor <= 0:
            raise InputError(
                "no scale of an image", source="factor", seen=repr(factor),
                needed="a number above 0",
            )  # fmt: skip
        return replace(
            self,
            width=round(self.width * factor),
            height=round(self.height * factor),
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=(self.cx + 0.5) * factor - 0.5,
            cy=(self.cy + 0.5) * factor - 0.5,
        )

    def resized(self, width: int, height: int) -> Camera:
        """The same view in an image of another size, its pixels of other proportions if need be.

        >>> Camera(640, 480, 500.0, 500.0, 319.5, 239.5).resized(320, 120).fy
        125.0
        """
        across, along = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * across,
            fy=self.fy * along,
            cx=(self.cx + 0.5) * across - 0.5,
            cy=(self.cy + 0.5) * along - 0.5,
        )

    def cropped(self, rows: slice, columns: slice) -> Camera:
        """The camera of the window image[rows, columns]."""
        top, bottom, _ = rows.indices(self.height)
        left, right, _ = columns.indices(self.width)
        return replace(
            self, width=right - left, height=bottom - top, cx=self.cx - left, cy=self.cy - top
        )


def _image_shape(shape: Any) -> tuple[int, int]:
    """(height, width) as two int; raises InputError."""
    sides = tuple(shape) if isinstance(shape, (tuple, list, np.ndarray)) else ()
    whole = all(isinstance(side, Integral) and not isinstance(side, bool) for side in sides)
    if len(sides) != 2 or not whole or min(sides) < 1:
        raise InputError(
            "this is not the size of an image",
            source="shape",
            seen=str(shape)[:80],
            needed="(height, width), two whole numbers above 0",
            remedy="photographs.shape[-3:-1] is that of colour photographs (N, H, W, 3)",
        )
    return int(sides[0]), int(sides[1])


def _intrinsics(K: Any) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of a calibration matrix; raises InputError."""

    def refused(what: str, seen: object, needed: str, remedy: str) -> InputError:
        return InputError(what, source="K", seen=str(seen), needed=needed, remedy=remedy)

    form = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
    remedy = "give the camera's 3 x 3 calibration matrix in pixels"
    if isinstance(K, (list, tuple)):
        try:
            K = np.array(K)
        except ValueError as error:  # rows of different length
            raise refused("not a calibration matrix", type(K).__name__, form, remedy) from error
    if not isinstance(K, np.ndarray) or isinstance(K, np.ma.MaskedArray):
        raise refused("not a calibration matrix", type(K).__name__, form, remedy)
    if K.shape != (3, 3) or K.dtype.kind not in "fiu":
        raise refused("not a calibration matrix", f"{K.shape} {K.dtype}", form, remedy)
    if not np.isfinite(K).all():
        raise refused("a calibration matrix with holes", K.tolist(), "finite numbers", remedy)
    if np.any(K[2] != [0, 0, 1]):
        remedy = "transpose K" if (K[:, 2] == [0, 0, 1]).all() else "divide K by K[2, 2]"
        raise refused("the last row is another", K[2].tolist(), "[0, 0, 1]", remedy)
    if K[1, 0] != 0 or K[0, 1] != 0:
        remedy = "undistort the photographs to a camera without skew"
        raise refused("a camera with skew", f"{K[0, 1]:g} and {K[1, 0]:g}", "both 0", remedy)
    fx, fy, cx, cy = (float(K[where]) for where in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if min(fx, fy) <= 0:
        remedy = "y points down and z forward here: the focal lengths in pixels are positive"
        raise refused("not focal lengths", f"fx = {fx:g}, fy = {fy:g}", "both above 0", remedy)
    return fx, fy, cx, cy


def _distortion(given: Any) -> Distortion | None:
    """A Distortion as it is, numbers as OpenCV's; raises InputError."""
    if given is None or isinstance(given, Distortion):
        return given
    numbers = list(np.ravel(given)) if isinstance(given, np.ndarray) else given
    if isinstance(numbers, (list, tuple)) and len(numbers) in (12, 14):
        # OpenCV pads its coefficients: thin prism and tilt, which are hardly ever used.
        numbers = numbers[:8] if not np.any(numbers[8:]) else numbers
    return Distortion("brown-conrady", numbers)  # type: ignore[arg-type]


def _refuse_exchanged_sides(camera: Camera) -> None:
    """Raise InputError where the principal point is central only with the sides exchanged."""
    height, width = camera.shape
    near = 0.02 * max(height, width)  # calibrated principal points are mostly as near

    def off_centre(wide: int, high: int) -> float:
        return max(abs(camera.cx - (wide - 1) / 2), abs(camera.cy - (high - 1) / 2))

    if off_centre(height, width) <= near < off_centre(width, height):
        raise InputError(
            "height and width look exchanged",
            source="shape",
            seen=f"(height, width) = {camera.shape}, principal point ({camera.cx:g}, "
            f"{camera.cy:g})",
            needed="a principal point near the centre",
            remedy=f"give ({width}, {height})",
        )


@dataclass(frozen=True, slots=True, eq=False)
class RigidTransform:
    """X_target = rotation @ X_source + translation_m; rotation (3, 3), translation in metres."""

    rotation: Floats
    translation_m: Floats


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """How noisy a depth sensor is: sigma_m * (z / at_m)^growth at depth z.

    sigma_m : standard deviation of one measurement at the depth at_m, both metres
    growth : 2 for triangulation (stereo, structured light), about 1 for time of flight, 0 for
        noise that is the same everywhere

    The default is Khoshelham & Elberink's (Sensors 12, 2012) for structured light, 1.425e-3 z^2.

    >>> SensorNoise().at(np.array([1.0, 2.0])).tolist()
    [0.001425, 0.0057]
    """

    sigma_m: float = 1.425e-3
    at_m: float = 1.0
    growth: float = 2.0

    def at(self, depth_m: Floats) -> Floats:
        """Standard deviation in metres of measurements of `depth_m`, metres."""
        return np.asarray(self.sigma_m * (depth_m / self.at_m) ** self.growth)


@dataclass(frozen=True, slots=True)
class Finding:
    """Something a person should know about a capture or a result.

    `code` is stable and short ("saturated"), `message` one line with figures, `remedy` what to
    do about it.
    """

    severity: Literal["note", "warning"]
    code: str
    message: str
    remedy: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Lights:
    """First-order spherical harmonics of every photograph's light.

    Photograph i, channel c sees a surface of albedo rho and normal n as
    rho * (max(0, s @ n) + ambient[i, c] * (1 + d @ n)).  Of a distant lamp s is vector[i, c]
    everywhere; of one at P = position_m[i, c] it is that at M = middle_m, and at a point X

        s = intensity[i, c] * (P - X) / |P - X| * (|P - M| / |P - X|)^2

    A lamp whose light falls off to the sides of where it is aimed has a beam.  Of one whose light
    has the standard deviation sigma across, aimed at A beside M, with u towards the lamp,

        s is multiplied by  exp(b . (X - M) + w (u . (X - M))^2),  b = (A - M) / sigma^2,
        w = 1 / (2 sigma^2);

    the rest of its Gaussian, exp(-w |X - M|^2), is the same in all photographs and counts as paint.

    vector : (N, C, 3) direction towards the lamp times its intensity, camera frame; C is 1 for
        white lights (shared by the channels) or 3 for coloured ones
    ambient : (N, C)
    position_m : (N, C, 3) of the lights in metres, camera frame, None for distant lights; a distant
        one among near ones stands at `FARTHEST_M`
    middle_m : (3,) the object's middle in metres, None for distant lights without beams
    beam : (N, C, 3) b_x and b_y, 1/metre, and w, 1/metre^2; None without beams
    ambient_direction : (3,) d, camera frame: the side that more of the ambient light comes from, in
        all photographs; None where it is the same on all normals

    >>> lights = Lights(vector=np.array([[[0.0, 0.0, -2.0]]]), ambient=np.array([[0.1]]))
    >>> lights.direction[0, 0].tolist(), float(lights.intensity[0, 0])
    ([0.0, 0.0, -1.0], 2.0)
    """

    vector: Floats
    ambient: Floats
    position_m: Floats | None = None
    middle_m: Floats | None = None
    beam: Floats | None = None
    ambient_direction: Floats | None = None

    def __len__(self) -> int:
        return len(self.vector)

    def __post_init__(self) -> None:
        if (self.position_m is None and self.beam is None) != (self.middle_m is None):
            raise InputError(
                "lights' positions or beams and the middle of the object go together",
                source="Lights",
                seen="middle_m alone" if self.middle_m is not None else "no middle_m",
                needed="position_m or beam with middle_m, or none of them",
            )

    def of(self, photograph: int) -> Lights:
        """One photograph's alone, N being 1.

        >>> both = Lights(vector=np.eye(3)[:2, None], ambient=np.array([[0.1], [0.2]]))
        >>> both.of(1).vector.tolist(), both.of(1).ambient.tolist()
        ([[[0.0, 1.0, 0.0]]], [[0.2]])
        """
        one = slice(photograph, photograph + 1)
        position, beam = (
            None if each is None else each[one] for each in (self.position_m, self.beam)
        )
        return replace(
            self, vector=self.vector[one], ambient=self.ambient[one], position_m=position, beam=beam
        )

    def ambient_on(self, normals: Floats) -> Floats:
        """(N, P, C) ambient light on P unit normals (P, 3)."""
        even = np.broadcast_to(
            self.ambient[:, None], (len(self), len(normals), len(self.ambient.T))
        )
        if self.ambient_direction is None:
            return even
        return np.asarray(even * (1 + normals @ self.ambient_direction)[None, :, None])

    @property
    def distance_m(self) -> Floats | None:
        """(N, C) of the lights from the object's middle, infinite for distant ones; or None."""
        if self.position_m is None or self.middle_m is None:
            return None
        distance = np.linalg.norm(self.position_m - self.middle_m, axis=-1)
        return np.where(distance < 0.99 * FARTHEST_M, distance, np.inf)

    @property
    def intensity(self) -> Floats:
        """(N, C) length of `vector`."""
        return np.asarray(np.linalg.norm(self.vector, axis=-1))

    @property
    def direction(self) -> Floats:
        """(N, C, 3) unit vectors towards the lights (zero where the intensity is zero)."""
        return self.vector / np.maximum(self.intensity, np.finfo(float).tiny)[..., None]


@dataclass(frozen=True, slots=True, eq=False)
class GivenLights:
    """Where the lights of N photographs stand, known before: a dome, a light stage, a chrome ball.

    Camera frame: x right, y down, z forward.  One of directions and positions_m is given.

    directions : (N, 3) unit vectors towards distant lights
    positions_m : (N, 3) of near lights, metres
    intensities : (N,) or, per channel, (N, 3), above 0, up to a common factor; of positions that of
        the light itself, which arrives by the inverse square of its distance; None when not known
    fixed : whether they are exact; else refining starts from them and corrects them

    >>> lights = GivenLights(directions=np.array([[0.0, 0.6, -0.8], [0.6, 0.0, -0.8]]), fixed=True)
    >>> len(lights), lights.select([1]).directions.tolist()
    (2, [[0.6, 0.0, -0.8]])
    """

    directions: Floats | None = None
    positions_m: Floats | None = None
    intensities: Floats | None = None
    fixed: bool = False

    def __len__(self) -> int:
        given = self.positions_m if self.directions is None else self.directions
        return 0 if given is None else len(given)

    def select(self, photographs: Iterable[int]) -> GivenLights:
        """Those of these photographs only (indices from 0); InputError for what is no index."""
        chosen = _indices(photographs, len(self))
        directions, positions_m, intensities = (
            None if each is None else each[chosen]
            for each in (self.directions, self.positions_m, self.intensities)
        )
        return GivenLights(directions, positions_m, intensities, self.fixed)


@dataclass(frozen=True, eq=False)
class Capture:
    """Photographs and depth of one object from one fixed camera, as they were read.

    photographs : (N, H, W, 3) uint8 or uint16, red green blue, encoded as `encoding` says
    depth_m : (K, h, w) float32 metres along the optical axis, NaN = no measurement
    mask : (H, W) bool, True = object
    camera : the colour camera
    depth_camera, depth_to_color : set when the depth is not in the colour camera's frame;
        without them the depth map covers the colour image's field of view exactly
    depth_noise : of the depth sensor, None when it is not known
    register : whether a small correction of depth_to_color is to be found from the photographs
    lights : where the lights stand, None when that is to be found from the photographs
    names : the photographs' file names
    exposures : of the photographs, beside each other: seconds * ISO / f-number^2; empty where they
        are alike, or not known
    findings : what the reader noticed
    source : where it came from, for messages
    """

    photographs: Array
    depth_m: Floats
    mask: Mask
    camera: Camera
    encoding: Encoding = "linear"
    lighting: Lighting = "moving-lamp"
    depth_camera: Camera | None = None
    depth_to_color: RigidTransform | None = None
    depth_noise: SensorNoise | None = None
    register: bool = False
    names: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    source: str = ""
    lights: GivenLights | None = None
    exposures: tuple[float, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        photographs: Array,
        depth: Floats,
        camera: Camera,
        *,
        mask: Array | None = None,
        encoding: Encoding | None = None,
        lighting: Lighting | None = None,
        names: Sequence[str] = (),
        depth_camera: Camera | None = None,
        depth_to_color: RigidTransform | None = None,
        depth_noise: SensorNoise | None = None,
        register: bool = False,
        ambient: Array | None = None,
        flat: Array | None = None,
        lights: GivenLights | None = None,
        exposures: Sequence[float] = (),
    ) -> Capture:
        """A capture of numpy arrays, by the rules of the capture folder.

        Parameters
        ----------
        photographs : (N, H, W, 3) or (H, W, 3), red green blue: uint8, uint16, or floating point
            from 0 to 1, which is kept with 16 bits
        depth : (h, w) or (K, h, w) floating point, metres along the optical axis; 0, negative,
            NaN, infinity, values below 0.1 mm, beyond 20 m and a far one that many pixels share are
            no measurement.  Several maps, repeats of one view, are averaged robustly
        camera : the colour camera
        mask : (H, W) bool or numbers, non-zero = object; None cuts out the object nearest to the
            camera, and a finding says so
        encoding : "linear" (values proportional to light) or "srgb".  When None, uint8 counts as
            "srgb", uint16 and floating point as "linear", and a finding says so
        lighting : "moving-lamp", "rgb-leds" or "ambient"; when None, one photograph counts as
            "ambient", several as "moving-lamp"
        names : of the photographs, for messages
        depth_camera, depth_to_color : of depth that is not in the colour camera's frame; the pose
            is the identity when None.  Without depth_camera the depth covers the photographs' field
            of view exactly: H / h and W / w are alike but for rounding, and need not be whole
        depth_noise : of the depth sensor, None when it is not known
        register : whether `multi-light` corrects a small error of depth_to_color
        ambient : (H, W, 3), of the photographs' type: one with the lamp off, which is subtracted in
            linear light
        flat : (H, W, 3) uint8, uint16 or floating point, encoded as the photographs: a white card
            that fills the image, by which vignetting is divided out.  With either the capture's
            photographs are linear, 16 bit
        lights : of the photographs, where they are known: the start of `multi-light` or, fixed, as
            given
        exposures : of the photographs, beside each other, where the camera changed them: seconds *
            ISO / f-number^2 of each.  What shows the same light twice as bright has 2 beside 1

        Returns
        -------
        the Capture; it keeps copies of the arrays, and in `findings` what a person should know

        Raises
        ------
        InputError
            something does not fit: the message names the argument, what was seen, what is needed
            and what to do.  CaptureError, one of its kinds, for the arrays.

        Examples
        --------
        >>> random = np.random.default_rng(0)
        >>> photographs = random.integers(50, 200, (3, 6, 8, 3), np.uint8)
        >>> capture = Capture.from_arrays(photographs, np.full((3, 4), 0.5),
        ...                               Camera(8, 6, 10.0, 10.0, 3.5, 2.5), mask=np.ones((6, 8)))
        >>> capture.depth_m.shape, capture.encoding, capture.lighting
        ((1, 3, 4), 'srgb', 'moving-lamp')
        """
        from rakelight.capture.from_arrays import capture_from_arrays

        return capture_from_arrays(
            photographs,
            depth,
            camera,
            mask=mask,
            encoding=encoding,
            lighting=lighting,
            names=names,
            depth_camera=depth_camera,
            depth_to_color=depth_to_color,
            depth_noise=depth_noise,
            register=register,
            ambient=ambient,
            flat=flat,
            lights=lights,
            exposures=exposures,
        )

    @property
    def white(self) -> float:
        """The largest value a photograph can hold: 255 or 65535."""
        return float(np.iinfo(self.photographs.dtype).max)

    @property
    def depth_checksum(self) -> str:
        """Eight hexadecimal digits that tell the depth maps from those of another capture."""
        return checksum(self.depth_m)

    def select(self, photographs: Iterable[int]) -> Capture:
        """The capture with only these photographs (indices from 0); the depth stays whole.

        Raises InputError for what is no index of a photograph.
        """
        chosen = _indices(photographs, len(self.photographs))
        return replace(
            self,
            photographs=self.photographs[chosen],
            names=selected(self.names, chosen),
            lights=None if self.lights is None else self.lights.select(chosen),
            exposures=selected(self.exposures, chosen),
        )


def _indices(photographs: Iterable[int], count: int) -> list[int]:
    """Indices of `count` photographs, as a list; raises InputError for what is none."""

    def refuse(seen: object, needed: str) -> NoReturn:
        raise InputError(
            "no index of a photograph", source="photographs", seen=repr(seen), needed=needed
        )

    try:
        listed = list(photographs)
    except TypeError:  # an array of no axis has __iter__, too
        refuse(photographs, "a list of them")
    for index in listed:
        whole = isinstance(index, Integral) and not isinstance(index, bool)
        if not whole or not -count <= index < count:
            refuse(index, f"a whole number from 0 to {count - 1}")
    return listed


def photograph_names(names: tuple[str, ...], count: int) -> tuple[str, ...]:
    """The names, or where there are none others to say which of `count` photographs is meant.

    >>> photograph_names((), 2)
    ('photograph 0', 'photograph 1')
    """
    return names or tuple(f"photograph {i}" for i in range(count))


def selected(each: tuple[T, ...], chosen: Iterable[int]) -> tuple[T, ...]:
    """What is said of the chosen photographs (indices from 0); nothing where nothing is said.

    >>> selected(("a", "b", "c"), [2, 0]), selected((), [2, 0])
    (('c', 'a'), ())
    """
    return tuple(each[i] for i in chosen) if each else ()


def checksum(depth_m: Floats) -> str:
    """CRC-32 of depth maps (K, h, w) as float32, in eight hexadecimal digits.

    >>> checksum(np.zeros((1, 2, 2))), checksum(np.ones((1, 2, 2)))
    ('ecbb4b55', 'e8681456')
    """
    return f"{zlib.crc32(np.ascontiguousarray(depth_m, '<f4').data):08x}"


@dataclass(frozen=True, eq=False)
class Truth:
    """What a synthetic capture really shows, at the colour camera's resolution.

    depth : (H, W) float32 metres, NaN outside the object
    normals : (H, W, 3) float32, camera frame, facing the camera, NaN outside
    albedo : (H, W, 3) float32 linear, 0 outside; NaN where it is not known
    lights : as rendered, None when they are not first-order harmonics
    """

    depth: Floats
    normals: Floats
    albedo: Floats
    lights: Lights | None = None

    @property
    def mask(self) -> Mask:
        """(H, W) True on the object."""
        return np.isfinite(self.depth)


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a long piece of work stands; handed to the `progress` callback."""

    stage: str
    step: int = 0
    steps: int = 0
    energy: float | None = None


ProgressCallback: TypeAlias = Callable[[Progress], None]


def silent(_: Progress) -> None:
    """The progress callback that does nothing."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """The surface of a result as triangles, in the camera frame (x right, y down, z forward).

    vertices_m : (V, 3) float32 metres
    faces : (F, 3) int32 into the vertices, counter-clockwise as the camera sees them
    normals : (V, 3) float32 unit vectors, facing the camera
    colors : (V, 3) uint8, the albedo, sRGB encoded
    """

    vertices_m: Floats
    faces: Array
    normals: Floats
    colors: Array


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Every pixel of a result as a point, row by row, in the camera frame.

    points_m : (P, 3) float32 metres
    normals : (P, 3) float32 unit vectors, facing the camera
    colors : (P, 3) uint8, the albedo, sRGB encoded
    """

    points_m: Floats
    normals: Floats
    colors: Array


@dataclass(frozen=True, eq=False)
class Result:
    """A refined depth map and all that was estimated with it, at the output resolution.

    depth : (H, W) float32 metres along the optical axis, NaN outside the object
    normals : (H, W, 3) float32 unit vectors, camera frame, facing the camera, NaN outside; those of
        the depth map, or finer ones where the method tells them
    albedo : (H, W, 3) float32 linear, 0 outside; scaled so that its 99th percentile is 1
    confidence : (H, W) float32 in 0..1, how much the photographs determine each pixel; halved
        where the sensor has no depth
    lights : of every photograph, in the albedo's scale
    camera : of these arrays
    prepared_depth : (H, W) float32 metres, the depth that the method started from
    method, options : name and every parameter with its value
    iterations : how many steps were taken, those of the finest level of several
    energy : one value per step since the loss last changed; converged says whether it came to rest
    timings_s : seconds per stage
    capture : what was read, in figures: photographs, photograph_size, bits, encoding, lighting,
        depth_maps, depth_size, depth_checksum; depth_to_color as corrected, where it was registered
    depth_sigma : (H, W) float32 metres, the expected error (root mean square) of `depth`, NaN
        outside the object; None where the method does not say
    normal_sigma : (H, W) float32 degrees, the same of `normals`
    prediction_errors : of every photograph from the others' albedo, as a fraction of its mean
        brightness; empty where there are fewer than three
    findings : what a person should know
    source : of the capture, for messages
    photograph_names : of the photographs that were used, one for each of `lights`; or none
    """

    depth: Floats
    normals: Floats
    albedo: Floats
    confidence: Floats
    lights: Lights
    camera: Camera
    prepared_depth: Floats
    method: str
    options: Mapping[str, Any] = field(default_factory=dict)
    iterations: int = 0
    energy: tuple[float, ...] = ()
    converged: bool = False
    timings_s: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    source: str = ""
    photograph_names: tuple[str, ...] = ()
    capture: Mapping[str, Any] = field(default_factory=dict)
    prediction_errors: tuple[float, ...] = ()
    depth_sigma: Floats | None = None
    normal_sigma: Floats | None = None

    @property
    def mask(self) -> Mask:
        """(H, W) True where there is depth."""
        return np.isfinite(self.depth)

    @property
    def expected_errors(self) -> tuple[float, float] | None:
        """Medians of `depth_sigma` (metres) and `normal_sigma` (degrees); None without them.

        >>> flat, facing = np.ones((1, 3)), np.tile([0.0, 0.0, -1.0], (1, 3, 1))
        >>> result = Result(flat, facing, np.ones((1, 3, 3)), flat, Lights(facing[0], flat),
        ...                 Camera(3, 1, 100.0, 100.0, 1.0, 0.0), flat, "none",
        ...                 depth_sigma=np.array([[0.001, np.nan, 0.003]]), normal_sigma=5 * flat)
        >>> result.expected_errors
        (0.002, 5.0)
        """
        if self.depth_sigma is None or self.normal_sigma is None:
            return None
        depth_m, normals_deg = (
            each[np.isfinite(each)] for each in (self.depth_sigma, self.normal_sigma)
        )
        if not (depth_m.size and normals_deg.size):
            return None
        return float(np.median(depth_m)), float(np.median(normals_deg))

    def mesh(self) -> Mesh:
        """The surface as triangles, none across a depth jump: what mesh.ply holds.

        Pixels that belong to no triangle have no vertex; where there are none at all it is empty.

        >>> flat, facing = np.ones((2, 3)), np.tile([0.0, 0.0, -1.0], (2, 3, 1))
        >>> result = Result(flat, facing, np.ones((2, 3, 3)), flat, Lights(facing[0], flat),
        ...                 Camera(3, 2, 100.0, 100.0, 1.0, 0.5), flat, "none")
        >>> mesh = result.mesh()
        >>> mesh.vertices_m.shape, mesh.faces.shape, mesh.colors[0].tolist()
        ((6, 3), (4, 3), [255, 255, 255])
        """
        from rakelight.export.mesh import result_mesh

        return result_mesh(self)

    def point_cloud(self) -> PointCloud:
        """Every pixel with depth as a point with its normal and colour.

        >>> hole = np.array([[1.0, np.nan, 1.0]])
        >>> facing = np.tile([0.0, 0.0, -1.0], (1, 3, 1))
        >>> result = Result(hole, facing, np.ones((1, 3, 3)), hole, Lights(facing, hole),
        ...                 Camera(3, 1, 4.0, 4.0, 1.0, 0.0), hole, "none")
        >>> result.point_cloud().points_m.tolist()
        [[-0.25, 0.0, 1.0], [0.25, 0.0, 1.0]]
        """
        from rakelight.export.mesh import result_points

        return result_points(self)

    def timed(self, **seconds: float) -> Result:
        """This result with the seconds of further stages."""
        return replace(self, timings_s={**self.timings_s, **seconds})
