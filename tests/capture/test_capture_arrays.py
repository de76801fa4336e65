"""faults.md 40: a Capture made in Python; no array may do harm, and each says what is needed."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rakelight.capture import write_capture
from rakelight.capture.arrays import checked_capture
from rakelight.errors import CaptureError, InputError, RakelightError
from rakelight.methods.multi_light import MultiLight
from rakelight.model import Camera, RigidTransform, SensorNoise, Truth
from rakelight.pipeline import refine
from tests.capture.capture_builder import small_capture

GOOD = small_capture()
N, H, W, _ = GOOD.photographs.shape
K, DEPTH_H, DEPTH_W = GOOD.depth_m.shape
NAMES = tuple(f"{i:03d}.png" for i in range(N))
SIDE = Camera(DEPTH_W, DEPTH_H, 20.0, 20.0, 5.0, 4.0)


def camera(**changes):
    return {"camera": replace(GOOD.camera, **changes)}


def pose(rotation, translation):
    return {"depth_camera": SIDE, "depth_to_color": RigidTransform(rotation, translation)}


def twice(chosen, names=("a", "b", "c", "d")):
    return {"photographs": GOOD.photographs[chosen], "names": names}


BAD = {
    "photographs": [
        ({"photographs": GOOD.photographs.astype(np.int32)}, "needed uint8 or uint16"),
        ({"photographs": GOOD.photographs / 255.0}, r"Fix: .* np.rint\(65535 \* photographs\)"),
        ({"photographs": GOOD.photographs.astype(object)}, "seen object"),
        ({"photographs": GOOD.photographs.astype(complex)}, "seen complex128"),
        ({"photographs": GOOD.photographs > 9}, "seen bool"),
        ({"photographs": GOOD.photographs.tolist()}, "not an array .seen list"),
        ({"photographs": None}, "seen NoneType"),
        ({"photographs": np.ma.masked_less(GOOD.photographs, 9)}, "fill what is masked"),
        ({"photographs": GOOD.photographs[:0]}, "none of them 0"),
        ({"photographs": GOOD.photographs[0]}, r"needed \(N, H, W, 3\)"),
        ({"photographs": GOOD.photographs[..., :1]}, r"needed \(N, H, W, 3\)"),
        ({"photographs": GOOD.photographs[..., 0]}, r"needed \(N, H, W, 3\)"),
        ({"photographs": GOOD.photographs[:, 1:]}, "does not fit"),
        (twice([0, 1, 2, 0]), "the same photograph twice .seen a and d.*Fix: remove d"),
        (twice([0, 1, 2, 0], ("a", "b", "c", "a")), "a at 0 and 3.*select each photograph once"),
        ({"photographs": np.zeros_like(GOOD.photographs)}, "all black .seen .*photograph 3"),
    ],
    "depth_m": [
        ({"depth_m": GOOD.depth_m[:0]}, "none of them 0"),
        ({"depth_m": GOOD.depth_m[0]}, r"needed \(K, h, w\)"),
        ({"depth_m": (1000 * np.nan_to_num(GOOD.depth_m)).astype(np.uint16)}, "values_per_metre"),
        ({"depth_m": GOOD.depth_m.astype(np.float16)}, "seen float16"),
        ({"depth_m": np.full_like(GOOD.depth_m, np.nan)}, "almost no depth"),
        ({"depth_m": np.full_like(GOOD.depth_m, 600)}, "unit looks wrong"),
        ({"depth_m": np.zeros_like(GOOD.depth_m)}, "depth that none can be .seen 0 and"),
        ({"depth_m": -GOOD.depth_m}, r"seen -.*depth_m\[~\(\(depth_m >= 0\.0001\)"),
        ({"depth_m": np.full_like(GOOD.depth_m, np.inf)}, "seen inf"),
        ({"depth_m": GOOD.depth_m[:, :, 1:]}, "sizes do not fit"),
        ({"depth_m": GOOD.depth_m[:, :, 1:], "depth_camera": SIDE}, "depth camera"),
    ],
    "mask": [
        ({"mask": GOOD.mask.astype(np.uint8)}, "Fix: mask > 0"),
        ({"mask": GOOD.mask[1:]}, "does not fit"),
        ({"mask": GOOD.mask[None]}, "another shape"),
        ({"mask": np.zeros_like(GOOD.mask)}, "the mask is empty"),
        ({"mask": None}, "seen NoneType"),
    ],
    "camera": [
        ({"camera": None}, "this is no Camera"),
        (camera(fx=np.nan), "fx is not a number"),
        (camera(cx=np.inf), "cx is not a number"),
        (camera(fy="20"), "fy is not a number"),
        (camera(width=float(W)), "needed a whole number"),
        (camera(fx=0.0), "fx is not positive"),
        (camera(fx=1e-200), "do not fit the image"),
        (camera(cx=-1e9), "do not fit the image"),
        (camera(height=-H), "height is not positive"),
    ],
    "depth_camera": [
        ({"depth_camera": 3}, "this is no Camera"),
        ({"depth_camera": replace(SIDE, fx=-1.0)}, "fx is not positive"),
    ],
    "depth_to_color": [
        (pose(np.eye(3)[:2], np.zeros(3)), "rotation is not an array"),
        (pose(np.eye(3).tolist(), np.zeros(3)), "rotation is not an array"),
        (pose(np.eye(3), np.full(3, np.nan)), "translation_m is not an array"),
        (pose(2 * np.eye(3), np.zeros(3)), "not a rotation"),
        (pose(np.eye(3), np.full(3, 50.0)), "implausibly long"),
    ],
    "depth_noise": [
        ({"depth_noise": 0.1}, "this is no SensorNoise"),
        ({"depth_noise": SensorNoise("0.001")}, "sigma_m is not a number"),
        ({"depth_noise": SensorNoise(-1.0)}, "not positive"),
    ],
    "encoding": [({"encoding": "gamma"}, "linear, srgb"), ({"encoding": ["srgb"]}, "unknown")],
    "lighting": [({"lighting": None}, "moving-lamp, rgb-leds, ambient")],
    "names": [
        ({"names": ("a",)}, f"none or {N}"),
        ({"names": "a" * N}, "seen str"),
        ({"names": tuple(range(N))}, "a tuple of str"),
    ],
    "exposures": [
        ({"exposures": (1.0, 1.0, 1.0, 1e30)}, "implausible exposures .seen 1 to 1e.30"),
        ({"exposures": (1e308, 1.0, 1.0, 1e-308)}, "all within a factor of 10000"),
        ({"exposures": (1e-320,) * N}, "needed 1e-12 to 1e.12"),
    ],
    "findings": [({"findings": ("note",)}, "a tuple of Finding")],
    "source": [({"source": None}, "this is no str")],
    "register": [({"register": "yes"}, "this is no bool")],
}


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [(name, *case) for name, cases in BAD.items() for case in cases],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_each_field_says_what_it_needs(name, changes, words):
    with pytest.raises(InputError, match=words) as refused:
        refine(replace(GOOD, **changes))
    assert refused.value.source in (name, "depth_m")
    assert refused.value.needed or refused.value.remedy


def test_a_photograph_selected_twice():
    with pytest.raises(CaptureError, match=r"twice .seen 001\.png at 1 and 2, counted from 0"):
        refine(replace(GOOD, names=NAMES).select([0, 1, 1, 2]))
    assert refine(GOOD.select([0, 1, 2]), options=MultiLight(max_iterations=1)).mask.any()


@pytest.mark.parametrize("capture", [None, "captures/mitten", GOOD.photographs])
def test_what_is_no_capture(capture, tmp_path):
    for function in (refine, lambda it: write_capture(it, tmp_path / "c")):
        with pytest.raises(InputError, match=r"this is no Capture .*Fix: load one with"):
            function(capture)
    assert list(tmp_path.iterdir()) == []


def test_depth_that_is_too_near_is_no_measurement():
    depth_m = GOOD.depth_m.copy()
    depth_m[:, :3] = 1e-6
    expected = np.where(depth_m < 1e-4, np.nan, depth_m)
    checked = checked_capture(replace(GOOD, depth_m=depth_m))
    np.testing.assert_array_equal(checked.depth_m, expected)
    assert depth_m[0, 0, 0] == np.float32(1e-6)  # the caller's stays


def test_arrays_of_other_layouts_are_as_good():
    def turned(array):
        return np.asfortranarray(array)[::-1][::-1]

    briefly = MultiLight(max_iterations=2)
    plain = refine(GOOD, options=briefly)
    captures = {
        "fortran": [turned(a) for a in (GOOD.photographs, GOOD.depth_m, GOOD.mask)],
        "strided": [np.repeat(a, 2, axis=-1)[..., ::2] for a in (GOOD.photographs, GOOD.depth_m)],
        "float64": [GOOD.photographs, GOOD.depth_m.astype(float)],
        "big-endian": [GOOD.photographs, GOOD.depth_m.astype(">f4")],
    }
    for changed in captures.values():
        fields = dict(zip(("photographs", "depth_m", "mask"), changed, strict=False))
        for array in changed:
            array.setflags(write=False)
        other = refine(replace(GOOD, **fields), options=briefly)
        np.testing.assert_array_equal(other.depth, plain.depth)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": None}, "method None is unknown"),
        ({"method": ["multi-light"]}, "is unknown"),
        ({"scale": [1]}, "scale: no scale"),
        ({"scale": None}, "scale: no scale"),
        ({"scale": np.ones(2)}, "scale: no scale"),
        ({"scale": "2"}, "scale: no scale"),
        ({"progress": 3}, "progress is no function"),
        ({"memory": 10**400}, "memory: not a limit of memory .seen a number of 1329 bits"),
        ({"memory": float("nan")}, "memory: not a limit of memory .seen nan"),
    ],
)
def test_arguments_of_another_type(options, words):
    with pytest.raises(InputError, match=words):
        refine(GOOD, **options)


@pytest.mark.parametrize("part", ["depth", "normals", "albedo"])
@pytest.mark.parametrize("bad", [None, np.ones((2, 2)), np.full((H, W, 3), "x")])
def test_a_truth_that_does_not_fit_is_not_written(tmp_path, part, bad):
    maps = {"depth": np.ones((H, W)), "normals": np.ones((H, W, 3)), "albedo": np.ones((H, W, 3))}
    with pytest.raises(CaptureError, match=rf"truth\.{part}: "):
        write_capture(GOOD, tmp_path / "c", truth=Truth(**{**maps, part: bad}))
    assert list(tmp_path.iterdir()) == []


# To make a failing capture smaller takes minutes, and tells no more of it.
PHASES = [Phase.explicit, Phase.reuse, Phase.generate]
# Sizes are near those that fit, so that many arrays pass the first checks.
SHAPES = {
    "photographs": st.tuples(
        st.integers(0, 4), st.sampled_from([0, 1, H]), st.sampled_from([1, W]), st.just(3)
    ),
    "depth_m": st.tuples(
        st.integers(0, 2), st.sampled_from([0, 1, DEPTH_H, H]), st.sampled_from([1, DEPTH_W, W])
    ),
    "mask": st.tuples(st.sampled_from([1, H]), st.sampled_from([0, 1, W])),
}
DTYPES = {
    "photographs": st.sampled_from(["u1", "u2"]) | arrays.scalar_dtypes(),
    "depth_m": st.sampled_from(["f4", "f8"]) | arrays.scalar_dtypes(),
    "mask": st.just("?") | arrays.scalar_dtypes(),
}


# Near one value, so that the methods are reached.
DEPTHS = st.sampled_from([0.0625, 0.5, 0.625, 16.0, np.nan]) | st.floats(2**-12, 2**16, width=32)
FITTING = {
    "photographs": arrays.arrays(
        np.uint8, GOOD.photographs.shape, elements=st.integers(0, 255), fill=st.just(99)
    ),
    "depth_m": arrays.arrays(
        np.float32, GOOD.depth_m.shape, elements=DEPTHS, fill=st.just(np.float32(0.5))
    ),
    "mask": arrays.arrays(bool, GOOD.mask.shape, fill=st.just(True)),
}


@st.composite
def any_capture(draw):
    changes = {}
    for name in draw(st.sets(st.sampled_from(sorted(SHAPES)), min_size=1)):
        if draw(st.booleans()):
            changes[name] = draw(FITTING[name])
            continue
        shape = draw(SHAPES[name] | arrays.array_shapes(min_dims=0, max_dims=5, max_side=12))
        changes[name] = draw(arrays.arrays(draw(DTYPES[name]), shape))
    return replace(GOOD, **changes)


def outcome(capture, method):
    """ "refused", in one line that says what is wrong, or "result", a whole one."""
    try:
        result = refine(capture, method)
    except RakelightError as error:
        line = str(error)
        return "refused" if line.isprintable() and len(line) < 3000 else f"message {line!r}"
    mask = result.mask
    assert mask.shape == capture.camera.shape
    assert mask.any()
    assert not (mask & ~capture.mask).any()
    for name in ("depth", "normals", "prepared_depth"):
        assert np.isfinite(getattr(result, name)[mask]).all()
        assert np.isnan(getattr(result, name)[~mask]).all()
    assert (result.depth[mask] > 0).all()
    np.testing.assert_allclose(np.linalg.norm(result.normals[mask], axis=-1), 1, atol=1e-5)
    assert (result.albedo >= 0).all()
    assert np.isfinite(result.albedo).all()
    assert ((result.confidence >= 0) & (result.confidence <= 1)).all()
    for sigma in (result.depth_sigma, result.normal_sigma):
        assert sigma is None or (sigma[mask] >= 0).all()
    return "result"


def assert_both(outcomes):
    """Nothing else; and both more than once, since a sample without results would show nothing.

    A tenth to a third give a result: of fresh examples none may, by chance.
    """
    assert set(outcomes) <= {"refused", "result"}
    if settings.default.derandomize:
        assert min(outcomes["refused"], outcomes["result"]) > 1


def test_any_arrays_are_refused_or_give_a_result():
    outcomes = Counter()

    @settings(
        max_examples=40, deadline=None, suppress_health_check=list(HealthCheck), phases=PHASES
    )
    @given(capture=any_capture(), method=st.sampled_from(["auto", "fusion-like", "rgb-ratio"]))
    def tried(capture, method):
        outcomes[outcome(capture, method)] += 1

    tried()
    assert_both(outcomes)


def test_any_values_are_refused_or_give_a_result():
    outcomes = Counter()

    @settings(
        max_examples=30, deadline=None, suppress_health_check=list(HealthCheck), phases=PHASES
    )
    @given(
        photographs=arrays.arrays(np.uint8, GOOD.photographs.shape, elements=st.integers(0, 255)),
        depth_m=arrays.arrays(np.float32, GOOD.depth_m.shape, elements=DEPTHS),
        mask=arrays.arrays(bool, GOOD.mask.shape),
        method=st.sampled_from(["auto", "fusion-like"]),
    )
    def tried(photographs, depth_m, mask, method):
        capture = replace(GOOD, photographs=photographs, depth_m=depth_m, mask=mask)
        outcomes[outcome(capture, method)] += 1

    tried()
    assert_both(outcomes)
