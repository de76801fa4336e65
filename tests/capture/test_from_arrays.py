"""Capture.from_arrays: the same capture as from a folder, and what is said of bad arrays."""

import warnings
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from rakelight.capture import load_capture, write_capture
from rakelight.capture.arrays import checked_capture
from rakelight.errors import InputError
from rakelight.model import Camera, Capture, GivenLights, RigidTransform, SensorNoise
from tests.capture.capture_builder import HEIGHT, WIDTH, small_capture

GOOD = small_capture()
PHOTOGRAPHS, DEPTH, MASK, CAMERA = GOOD.photographs, GOOD.depth_m, GOOD.mask, GOOD.camera
MAPS, DEPTH_HEIGHT, DEPTH_WIDTH = DEPTH.shape
SIDE = Camera(DEPTH_WIDTH, DEPTH_HEIGHT, 20.0, 20.0, 7.5, 5.5)


def made(photographs=PHOTOGRAPHS, depth=DEPTH, camera=CAMERA, **options):
    return Capture.from_arrays(photographs, depth, camera, **{"mask": MASK, **options})


def codes(capture):
    return [finding.code for finding in capture.findings]


def arrays_of(capture):
    return capture.photographs, capture.depth_m, capture.mask


# ---- what fits ----


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("masked", [True, False])
def test_arrays_and_a_folder_of_them_are_the_same_capture(tmp_path, dtype, masked):
    stored = small_capture(dtype=dtype, encoding="srgb", lighting="moving-lamp")
    if not masked:  # an object before nothing
        depth = np.where(stored.mask[::2, ::2], stored.depth_m, np.nan)
        stored = replace(stored, depth_m=depth)
    write_capture(stored, tmp_path / "capture")
    if not masked:
        (tmp_path / "capture" / "mask.png").unlink()
    read = load_capture(tmp_path / "capture")
    arrays = Capture.from_arrays(
        stored.photographs,
        stored.depth_m,
        stored.camera,
        mask=stored.mask if masked else None,
        encoding="srgb",
        names=[f"{i:03d}.png" for i in range(4)],
    )
    for ours, theirs in zip(arrays_of(arrays), arrays_of(read), strict=True):
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)
    ours, theirs = (replace(each, source="", **kept(read)) for each in (arrays, read))
    assert vars(ours) == vars(theirs)
    assert [finding.message for finding in arrays.findings] == [
        finding.message for finding in read.findings
    ]
    assert ("no-mask" in codes(arrays)) is not masked


def kept(capture):
    """What holds arrays, which `==` does not compare."""
    return dict(zip(("photographs", "depth_m", "mask"), arrays_of(capture), strict=True))


@pytest.mark.parametrize(
    ("photographs", "given", "encoding", "noted"),
    [
        (PHOTOGRAPHS, None, "srgb", True),
        (PHOTOGRAPHS, "linear", "linear", False),
        (small_capture(dtype=np.uint16).photographs, None, "linear", True),
        (PHOTOGRAPHS / 255, None, "linear", True),
        ((PHOTOGRAPHS / 255).astype(np.float32), "srgb", "srgb", False),
    ],
)
def test_encoding_by_the_kind_of_photograph(photographs, given, encoding, noted):
    capture = made(photographs, encoding=given)
    assert capture.encoding == encoding
    assert ("encoding-assumed" in codes(capture)) is noted


@pytest.mark.parametrize("dtype", [np.float32, np.float64, ">f4"])
def test_floating_point_is_kept_with_16_bits(dtype):
    values = np.random.default_rng(3).uniform(0.1, 0.9, PHOTOGRAPHS.shape)
    values[0, 0, 0] = 0, 1, 0.5
    capture = made(values.astype(dtype))
    assert capture.photographs.dtype == np.uint16
    assert capture.photographs[0, 0, 0].tolist() == [0, 65535, 32768]
    np.testing.assert_allclose(capture.photographs / 65535, values, atol=0.501 / 65535)


@pytest.mark.parametrize(
    ("count", "given", "lighting"),
    [(1, None, "ambient"), (4, None, "moving-lamp"), (1, "rgb-leds", "rgb-leds")],
)
def test_lighting_by_the_number_of_photographs(count, given, lighting):
    photographs = PHOTOGRAPHS[0] if count == 1 else PHOTOGRAPHS[:count]
    capture = made(photographs, lighting=given)
    assert capture.lighting == lighting
    assert capture.photographs.shape == (count, HEIGHT, WIDTH, 3)


def test_one_map_or_several_and_what_is_no_measurement():
    depth = DEPTH[0].astype(np.float64)
    depth[1, 1:6] = 0, -0.5, np.nan, np.inf, 1e300
    capture = made(depth=depth)
    assert capture.depth_m.shape == (1, DEPTH_HEIGHT, DEPTH_WIDTH)
    assert capture.depth_m.dtype == np.float32
    expected = DEPTH[:1].copy()
    expected[0, 1, 1:6] = np.nan
    np.testing.assert_array_equal(capture.depth_m, expected)


@pytest.mark.parametrize("nothing", [-1, -9999, np.finfo(np.float32).min])
def test_negative_values_for_nothing_may_be_most_of_the_depth(nothing):
    depth = DEPTH.copy()
    depth[:, 6:] = nothing
    with np.errstate(all="raise"):
        capture = made(depth=depth)
    np.testing.assert_array_equal(capture.depth_m[:, :6], DEPTH[:, :6])
    assert np.isnan(capture.depth_m[:, 6:]).all()


def test_depth_pixels_that_see_the_objects_rim_are_no_holes_of_it():
    """They see what lies around it as well, which a sensor may not measure."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[3:15, 5:19] = True
    depth = DEPTH.copy()
    whole = mask.reshape(DEPTH_HEIGHT, 2, DEPTH_WIDTH, 2).all(axis=(1, 3))
    depth[:, ~whole] = np.nan
    assert "depth-missing" not in codes(made(mask=mask, depth=depth))
    depth[:, 4, 5] = np.nan
    (holes,) = [f for f in made(mask=mask, depth=depth).findings if f.code == "depth-missing"]
    assert holes.message.startswith(f"{1 / whole.sum():.1%} of the object")


def test_holes_that_other_maps_fill_are_not_told_of():
    depth = DEPTH.copy()
    depth[0, 5, 6:10] = 0
    assert "depth-missing" not in codes(made(depth=depth))


def test_holes_on_the_object_are_counted_by_reason():
    depth = DEPTH.copy()
    depth[:, 5, 6:10] = 0, 0, -1, np.nan
    (holes,) = [f for f in made(depth=depth).findings if f.code == "depth-missing"]
    assert "4 zero, 2 negative, 2 not finite" in holes.message
    assert "without depth in all 2 maps (values of single maps: 4 zero" in holes.message


def test_sixteen_bit_nothing_divided_by_a_thousand_is_no_measurement():
    depth = DEPTH.copy()
    depth[:, 3:8, 3:6] = 65.535
    capture = made(depth=depth)
    assert np.isnan(capture.depth_m[:, 3:8, 3:6]).all()
    (holes,) = [f for f in capture.findings if f.code == "depth-missing"]
    assert "18 beyond 20 m" in holes.message
    by_hand = checked_capture(replace(made(), depth_m=depth))
    np.testing.assert_array_equal(by_hand.depth_m, capture.depth_m)
    assert holes in by_hand.findings
    depth[0, 3:8, 3:6] = 10.0
    depth[1, 5, 7] = 1e9
    assert np.isnan(made(depth=depth).depth_m[1, 5, 7])
    assert np.isnan(checked_capture(replace(made(), depth_m=depth)).depth_m[1, 5, 7])
    assert np.isnan(made(depth=depth).depth_m[:, 3:8, 3:6]).all()
    assert made(depth=capture.depth_m).depth_m.tobytes() == capture.depth_m.tobytes()


@pytest.mark.parametrize(("dtype", "noted"), [(np.uint8, True), (np.uint16, False)])
def test_eight_bits_that_are_said_to_be_linear_are_noted(dtype, noted):
    pixels = small_capture(dtype=dtype).photographs
    assert ("linear-8-bit" in codes(made(pixels, encoding="linear"))) is noted
    assert "linear-8-bit" not in codes(made(pixels, encoding="srgb")) + codes(made(pixels))


def test_intrinsics_of_a_smaller_image_are_doubted_and_those_of_a_crop_may_be():
    half = Camera.from_matrix(np.diag([0.5, 0.5, 1]) @ CAMERA.matrix, CAMERA.shape)
    (doubt,) = [f for f in made(camera=half).findings if f.severity == "warning"]
    assert doubt.code == "off-centre"
    assert "is the calibration of this size" in doubt.message
    assert "off-centre" not in codes(made())


@pytest.mark.parametrize(
    "mask", [MASK, MASK.astype(np.uint8) * 255, MASK.astype(int) * -3, MASK * 0.5]
)
def test_masks_of_any_number(mask):
    np.testing.assert_array_equal(made(mask=mask).mask, MASK)


def test_a_matrix_is_a_depth_map():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        matrix = np.matrix(DEPTH[0])
    np.testing.assert_array_equal(made(depth=matrix).depth_m, DEPTH[:1])


def test_the_capture_has_copies():
    given = [np.array(array) for array in (PHOTOGRAPHS, DEPTH, MASK)]
    for array in given:
        array.setflags(write=False)
    capture = Capture.from_arrays(*given[:2], CAMERA, mask=given[2])
    for ours, theirs in zip(arrays_of(capture), given, strict=True):
        assert not np.shares_memory(ours, theirs)
        ours[:] = 0
    for array, before in zip(given, (PHOTOGRAPHS, DEPTH, MASK), strict=True):
        np.testing.assert_array_equal(array, before)


def test_other_layouts_and_byte_orders_are_as_good():
    turned = made(
        np.asfortranarray(257 * PHOTOGRAPHS.astype(np.uint16)).astype(">u2")[:, ::-1][:, ::-1],
        DEPTH.astype(">f8")[..., ::-1][..., ::-1],
    )
    np.testing.assert_array_equal(turned.photographs, PHOTOGRAPHS * np.uint16(257))
    np.testing.assert_array_equal(turned.depth_m, DEPTH)
    assert turned.photographs.dtype == np.uint16
    assert turned.photographs.flags.c_contiguous


def test_a_depth_camera_of_its_own():
    pose = RigidTransform(np.eye(3), np.array([0.02, 0.0, 0.0]))
    noise = SensorNoise(0.002)
    capture = made(depth_camera=SIDE, depth_to_color=pose, depth_noise=noise, register=True)
    assert (capture.depth_camera, capture.depth_to_color) == (SIDE, pose)
    assert (capture.depth_noise, capture.register) == (noise, True)


@pytest.mark.parametrize("kind", [tuple, list, np.array])
def test_exposures_are_kept(kind):
    exposures = (1.0, 2.0, 0.5, 1.0)
    assert made(exposures=kind(exposures)).exposures == exposures
    assert made().exposures == ()


# ---- what does not ----


def one(array, index, value):
    changed = np.array(array)
    changed[index] = value
    return changed


FLOATS = PHOTOGRAPHS / 255.0
MILLIMETRES = np.nan_to_num(1000 * DEPTH)
POSE = RigidTransform(np.eye(3), np.zeros(3))

BAD = {
    # photographs
    "exchanged": ({"photographs": DEPTH, "depth": PHOTOGRAPHS}, "look exchanged"),
    "exchanged, one": ({"photographs": DEPTH[0], "depth": PHOTOGRAPHS[0]}, "look exchanged"),
    "a list": ({"photographs": list(PHOTOGRAPHS)}, r"seen list.*np\.stack\(photographs\)"),
    "nothing": ({"photographs": None}, "seen NoneType"),
    "masked": ({"photographs": np.ma.masked_less(PHOTOGRAPHS, 9)}, r"photographs\.filled"),
    "objects": ({"photographs": PHOTOGRAPHS.astype(object)}, "array of objects"),
    "strings": ({"photographs": PHOTOGRAPHS.astype(str)}, "seen <U3"),
    "bools": ({"photographs": PHOTOGRAPHS > 9}, "seen bool"),
    "int64": ({"photographs": PHOTOGRAPHS.astype(int)}, r"seen int64.*astype\(np\.uint16\)"),
    "complex": ({"photographs": PHOTOGRAPHS.astype(complex)}, "seen complex128"),
    "grey": ({"photographs": PHOTOGRAPHS[..., 0]}, r"np\.repeat\(photographs\[\.\.\., None\]"),
    "grey channel": ({"photographs": PHOTOGRAPHS[..., :1]}, r"np\.repeat\(photographs, 3"),
    "alpha": (
        {"photographs": np.concatenate([PHOTOGRAPHS, PHOTOGRAPHS[..., :1]], -1)},
        ":3. drops",
    ),
    "channels first": ({"photographs": np.moveaxis(PHOTOGRAPHS, -1, 1)}, "puts the channels last"),
    "five axes": ({"photographs": PHOTOGRAPHS[None]}, r"needed \(N, H, W, 3\) or \(H, W, 3\)"),
    "none": ({"photographs": PHOTOGRAPHS[:0]}, "none of them 0"),
    "of another size": ({"photographs": PHOTOGRAPHS[:, 1:]}, r"camera\.resized\(width, height\)"),
    "turned": ({"photographs": PHOTOGRAPHS.swapaxes(1, 2)}, "does not fit the capture's camera"),
    "twice": ({"photographs": PHOTOGRAPHS[[0, 1, 0]]}, "seen photograph 0 and photograph 2"),
    "NaN": ({"photographs": one(FLOATS, (0, 0, 0), np.nan)}, "seen 3 of them.*nan_to_num"),
    "infinite": ({"photographs": one(FLOATS, (0, 0, 0, 0), np.inf)}, "seen 1 of them"),
    "up to 255": ({"photographs": FLOATS * 255}, r"seen 51 to 203.*Fix: photographs / 255"),
    "up to 4095": ({"photographs": FLOATS * 4095}, "white level"),
    "a little bright": ({"photographs": one(FLOATS, (0, 0, 0), 1.01)}, r"np\.clip.*saturated"),
    "a little dark": ({"photographs": one(FLOATS, (0, 0, 0), -0.01)}, r"np\.clip.*black level"),
    "black": ({"photographs": FLOATS / 1000}, "fewer than 3 usable photographs.*expose longer"),
    # depth
    "millimetres": (
        {"depth": MILLIMETRES},
        r"median depth 600 m.*by 1000 if they are milli",
    ),
    "uint16": ({"depth": MILLIMETRES.astype(np.uint16)}, r"seen uint16.*depth / 1000\.0"),
    "float16": ({"depth": DEPTH.astype(np.float16)}, "seen float16, needed metres as float32"),
    "complex depth": ({"depth": DEPTH.astype(complex)}, "seen complex128"),
    "object depth": ({"depth": DEPTH.astype(object)}, "array of objects"),
    "masked depth": ({"depth": np.ma.masked_invalid(DEPTH)}, r"depth\.filled\(np\.nan\)"),
    "list of depth": ({"depth": DEPTH.tolist()}, r"seen list.*np\.asarray\(depth\)"),
    "no depth": ({"depth": None}, "seen NoneType"),
    "one number": ({"depth": np.array(0.6)}, r"seen \(\), needed \(h, w\) or \(K, h, w\)"),
    "depth axes": ({"depth": DEPTH[None]}, r"needed \(h, w\) or \(K, h, w\)"),
    "depth channel": ({"depth": DEPTH[0][..., None]}, r"Fix: depth\[\.\.\., 0\]"),
    "depth picture": ({"depth": np.repeat(DEPTH[0][..., None], 3, -1)}, "one channel"),
    "no maps": ({"depth": DEPTH[:0]}, "none of them 0"),
    "no measurement": ({"depth": np.zeros_like(DEPTH)}, "almost no depth on the object"),
    "no measurement, no mask": ({"depth": 0 * DEPTH, "mask": None}, "no depth at all"),
    "backwards": ({"depth": -DEPTH}, r"seen median -0\.599 m.*Fix: -depth"),
    "sizes": ({"depth": DEPTH[:, :, 1:]}, "sizes do not fit.*give the depth camera"),
    "wide": ({"depth": DEPTH[:, 1:-2]}, "seen depth 16x9, colour 32x24, needed .* to half a pixel"),
    "finer": ({"depth": DEPTH.repeat(3, 1).repeat(3, 2)}, "seen depth 48x36.*no larger"),
    "of two units": (
        {"depth": np.stack([DEPTH[0], 2 * DEPTH[1]])},
        "contradict each other .seen median 0.599 m in map 0, 1.2 m in map 1",
    ),
    "of two units, no mask": (
        {"depth": np.stack([DEPTH[0], 2 * DEPTH[1]]), "mask": None},
        "contradict each other",
    ),
    "far": ({"depth": np.full_like(DEPTH, 1e9)}, "depth that none can be .seen 1e.09"),
    # mask
    "empty mask": ({"mask": np.zeros_like(MASK)}, "the mask is empty"),
    "mask NaN": ({"mask": one(MASK * 1.0, (0, 0), np.nan)}, "seen 1 NaN"),
    "mask size": ({"mask": MASK[::2, ::2]}, r"cv2\.resize\(mask, \(32, 24\)"),
    "mask turned": ({"mask": MASK.T}, r"Fix: mask\.T"),
    "mask picture": ({"mask": np.dstack([MASK] * 3)}, r"mask\.any\(axis=-1\)"),
    "mask in front": ({"mask": MASK[None]}, r"mask\.any\(axis=0\)"),
    "mask list": ({"mask": MASK.tolist()}, r"np\.asarray\(mask\)"),
    "mask of text": ({"mask": MASK.astype(str)}, "not a mask"),
    "masked mask": ({"mask": np.ma.array(MASK)}, r"mask\.filled"),
    # the rest
    "camera": ({"camera": CAMERA.matrix}, r"no Camera.*Camera\.from_matrix"),
    "camera size": ({"camera": CAMERA.scaled(2)}, r"does not fit the capture's camera"),
    "normalised": ({"camera": replace(CAMERA, fx=1.2, fy=1.2)}, "give pixels"),
    "camera of a larger image": (
        {"camera": Camera.from_matrix(np.diag([4, 4, 1]) @ CAMERA.matrix, CAMERA.shape)},
        "camera: the principal point lies outside the image .seen cx = 6",
    ),
    "camera NaN": ({"camera": replace(CAMERA, cx=np.nan)}, "cx is not a number"),
    "camera beyond floats": ({"camera": replace(CAMERA, fx=10**400)}, "fx is not a number"),
    "encoding array": ({"encoding": np.array(["linear", "srgb"])}, "an unknown encoding"),
    "encoding": ({"encoding": "gamma"}, "unknown encoding.*linear, srgb"),
    "lighting": ({"lighting": "lamp"}, "unknown lighting.*moving-lamp, rgb-leds, ambient"),
    "names": ({"names": ["a"]}, "seen 1 for 4 photographs, needed none or 4"),
    "names text": ({"names": "abcd"}, "seen str"),
    "depth camera": ({"depth_camera": SIDE.matrix}, r"no Camera.*Camera\.from_matrix"),
    "depth camera size": ({"depth_camera": SIDE.scaled(2)}, "the capture's depth camera"),
    "pose alone": ({"depth_to_color": POSE}, "without depth_camera"),
    "pose": ({"depth_camera": SIDE, "depth_to_color": np.eye(4)}, "no RigidTransform"),
    "pose in float16": (
        {
            "depth_camera": SIDE,
            "depth_to_color": RigidTransform(np.eye(3, dtype=np.float16), np.zeros(3)),
        },
        r"seen ndarray \(3, 3\) float16, needed a numpy\.ndarray \(3, 3\), float64",
    ),
    "pose scaled": (
        {"depth_camera": SIDE, "depth_to_color": RigidTransform(2 * np.eye(3), np.zeros(3))},
        "not a rotation",
    ),
    "pose in millimetres": (
        {"depth_camera": SIDE, "depth_to_color": RigidTransform(np.eye(3), np.full(3, 25.0))},
        "not millimetres",
    ),
    "elsewhere": (
        {
            "depth_camera": SIDE,
            "depth_to_color": RigidTransform(np.diag([-1.0, 1.0, -1.0]), np.zeros(3)),
            "mask": None,
        },
        "sees nothing of what has depth.*check depth_camera and depth_to_color",
    ),
    "noise": ({"depth_noise": 0.002}, "no SensorNoise"),
    "noise in millimetres": ({"depth_noise": SensorNoise(1.4)}, "not millimetres"),
    "register": ({"register": 1}, "no bool"),
    "exposures of others": ({"exposures": (1.0, 2.0)}, "seen 2, needed 4"),
    "exposure of none": ({"exposures": (1.0, 0.0, 1.0, 1.0)}, "needed numbers above 0"),
    "exposures in a table": ({"exposures": np.ones((4, 1))}, "needed numbers above 0"),
}
ARGUMENTS = {
    *("photographs", "depth", "camera", "mask", "encoding", "lighting", "names"),
    *("depth_camera", "depth_to_color", "depth_noise", "register", "exposures"),
}


@pytest.mark.parametrize("name", BAD)
def test_each_fault_says_what_is_needed_and_what_to_do(name):
    changes, words = BAD[name]
    with pytest.raises(InputError, match=words) as refused:
        made(**changes)
    line = str(refused.value)
    assert refused.value.source in ARGUMENTS
    assert line.isprintable()
    assert "seen " in line
    assert "needed " in line
    assert ". Fix: " in line


@pytest.mark.parametrize("wrong", [99, -5, True, 1.0, "0"])
def test_what_is_no_photograph_cannot_be_selected(wrong):
    lights = GivenLights(np.tile([0.0, 0.0, -1.0], (4, 1)))
    for whole in (made(), lights):
        with pytest.raises(InputError, match=r"photographs: no index of a photograph .*0 to 3"):
            whole.select([0, wrong])
        with pytest.raises(InputError, match=r"photographs: no index of a photograph .*a list"):
            whole.select(2)
        with pytest.raises(InputError, match=r"photographs: no index of a photograph .*a list"):
            whole.select(np.array(3))
    assert made().select(np.array([2, -1])).names == made().select([2, 3]).names


def test_sequences_of_any_kind_are_names_and_exposures():
    exposures = (
        np.arange(1, 5, dtype=np.float32),
        range(1, 5),
        [Fraction(each) for each in (1, 2, 3, 4)],
    )
    for given in exposures:
        found = made(exposures=given).exposures
        assert found == (1.0, 2.0, 3.0, 4.0)
        assert {type(each) for each in found} == {float}
    assert made(names=np.array(list("abcd"))).names == ("a", "b", "c", "d")
    for wrong in ("abcd", np.arange(4), np.array("abcd")):
        with pytest.raises(InputError, match="names: not a tuple of str"):
            made(names=wrong)
    assert made(register=np.bool_(False)).register is False


@pytest.mark.parametrize("name", ["ambient", "flat"])
@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (np.full(PHOTOGRAPHS.shape[1:], 0.2), r"needed uint8\)\. Fix: np\.rint\(255 \* {}\)"),
        (np.full(PHOTOGRAPHS.shape[1:], 20.0), "Fix: {} / 255, if"),
        (np.full(PHOTOGRAPHS.shape[1:], 20), r"Fix: {}\.astype\(np\.uint16\)"),
        (np.ma.masked_equal(PHOTOGRAPHS[0], 0), r"Fix: {}\.filled\(0\)"),
    ],
)
def test_what_is_wrong_with_a_picture_is_mended_there(name, picture, words):
    with pytest.raises(InputError, match=f"^{name}: .*{words.format(name)}"):
        made(**{name: picture})


def test_a_map_in_another_unit_among_others_is_refused():
    maps = np.concatenate([DEPTH[:1], 1000 * DEPTH[:1], DEPTH[:1]])
    for holes in (False, True):
        maps[1, ::3] = 0 if holes else maps[1, ::3]
        with pytest.raises(InputError, match=r"no distance .* in map 1, .*Fix: remove map 1, or"):
            made(depth=maps)


def test_depth_that_is_no_number_is_not_to_be_converted():
    with pytest.raises(InputError, match=r"seen bool, .*Fix: give the depth itself, in metres"):
        made(depth=DEPTH > 0)
