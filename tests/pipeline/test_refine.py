"""Choosing a method, its options, progress, and the way from folder to folder."""

import json
import tomllib
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import rakelight
from rakelight.capture import load_capture, load_truth, write_capture
from rakelight.errors import InputError, MethodError
from rakelight.export import load_result
from rakelight.methods import METHODS, Method, choose_method, load_method, method_of
from rakelight.methods.base import Estimate, photometric_confidence, scatter
from rakelight.methods.multi_light_alternating import MultiLightAlternating
from rakelight.model import Camera, Finding, Lights, Progress
from rakelight.pipeline import coming_through, refine
from rakelight.report import save_result
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene


def make_scene():
    return render_scene(
        make_shape("vase"),
        make_albedo("pattern"),
        SceneOptions(
            camera=make_shape("vase").camera.scaled(0.15),
            photographs=5,
            depth_factor=2,
            depth_frames=2,
            depth_noise=DepthNoise(rms_mm=2.0, hole_fraction=0.02),
            bits=8,
            encoding="srgb",
        ),
    )


@pytest.fixture(scope="module")
def joint(capture):
    """What `refine` makes of the capture by default."""
    return refine(capture)


# ---- choice


@pytest.mark.parametrize("name", METHODS)
def test_every_method_loads_under_its_name(name):
    method = load_method(name)
    assert method.name == name
    assert method.options() == method.options()


def test_unknown_methods_name_the_available_ones(capture):
    with pytest.raises(MethodError, match="'shape-from-hope' is unknown") as error:
        refine(capture, "shape-from-hope")
    for name in ("auto", *METHODS):
        assert f" {name}," in error.value.needed + ","


def test_auto_takes_a_method_that_exists(capture, joint):
    assert choose_method(capture) in METHODS
    assert joint.method == choose_method(capture)


@pytest.mark.parametrize(
    ("lighting", "method"),
    [("moving-lamp", "fusion-like"), ("rgb-leds", "rgb-ratio"), ("ambient", "fusion-like")],
)
def test_auto_with_one_photograph(capture, lighting, method):
    assert choose_method(replace(capture.select([0]), lighting=lighting)) == method


# ---- options


@dataclass(frozen=True)
class OtherOptions:
    max_iterations: int = 3


@pytest.mark.parametrize(
    "options", [OtherOptions(), {"max_iterations": 3}, 3, MultiLightAlternating]
)
def test_options_of_another_method_are_refused(capture, options):
    with pytest.raises(MethodError, match="options are not for multi-light-alternating") as error:
        refine(capture, "multi-light-alternating", options=options)
    assert error.value.needed == "rakelight.MultiLightAlternating"


def test_options_alone_choose_their_method(capture):
    result = refine(capture, rakelight.MultiLightAlternating(max_iterations=2, depth_weight=3.0))
    named = refine(
        capture,
        "multi-light-alternating",
        options=MultiLightAlternating(max_iterations=2, depth_weight=3.0),
    )
    assert (result.method, result.options) == (named.method, named.options)
    assert result.method == "multi-light-alternating"
    np.testing.assert_array_equal(result.depth, named.depth)


@pytest.mark.parametrize("name", METHODS)
def test_the_method_of_options(name):
    kind = load_method(name).options

    class Finer(kind):
        """Options of one's own class are still of that method."""

    assert method_of(kind()) == method_of(Finer()) == name
    assert method_of(kind) is None


def test_the_class_of_options_is_not_its_value(capture):
    with pytest.raises(
        MethodError, match=r"the class MultiLight is no method .*Fix: give a name, or"
    ):
        refine(capture, rakelight.MultiLight)
    with pytest.raises(
        MethodError, match=r"seen the class MultiLight, needed rakelight\.MultiLight"
    ):
        refine(capture, options=rakelight.MultiLight)


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("ldr-ps", rakelight.MultiLight(), "not for ldr-ps .*MultiLight, needed rakelight.LdrPs"),
        ("auto", rakelight.LdrPs(), "not for multi-light .seen rakelight.LdrPs"),
        # RGBD-Fusion's are a subclass of theirs
        ("fusion-like", rakelight.RgbdFusion(), "seen rakelight.RgbdFusion, needed .*FusionLike"),
        ("rgbd-fusion", rakelight.FusionLike(), "seen rakelight.FusionLike, needed .*RgbdFusion"),
        (rakelight.LdrPs(), rakelight.LdrPs(), "options twice"),
    ],
)
def test_method_and_options_that_disagree(capture, method, options, words):
    with pytest.raises(MethodError, match=words) as refused:
        refine(capture, method, options=options)
    assert refused.value.remedy


def test_a_method_of_ones_own(capture):
    ours = Method("kept-depth", lambda prepared, options, progress: kept_depth(prepared), Kept)
    result = refine(capture, ours, options=Kept(weight=2.0))
    assert (result.method, result.options) == ("kept-depth", {"weight": 2.0})
    assert refine(capture, ours).options == {"weight": 1.0}
    np.testing.assert_allclose(
        result.depth[result.mask], result.prepared_depth[result.mask], rtol=1e-6
    )
    with pytest.raises(MethodError, match=r"seen rakelight\.LdrPs, needed Kept"):
        refine(capture, ours, options=rakelight.LdrPs())


def test_a_method_of_ones_own_may_have_the_pose_corrected(capture):
    def run(prepared, options, progress):
        return kept_depth(prepared)

    ours = Method("kept-depth", run, Kept, corrects_pose=True)
    result = refine(replace(capture, register=True), ours)
    assert result.options == {"weight": 1.0}
    assert {"registered", "registration-doubtful"} & {f.code for f in result.findings}


@pytest.mark.parametrize(("sigma_deg", "warned"), [(14.0, False), (16.0, True)])
def test_normals_that_are_expected_to_be_far_off_are_told(capture, sigma_deg, warned):
    def unsure(prepared, options, progress):
        doubt = np.where(prepared.mask, sigma_deg, np.nan)
        return replace(kept_depth(prepared), normal_sigma=doubt, depth_sigma=doubt / 1000)

    result = refine(capture, Method("unsure", unsure, Kept))
    assert result.expected_errors == pytest.approx((sigma_deg / 1000, sigma_deg))
    said = [f.message for f in result.findings if f.code == "normals-uncertain"]
    expected = f"half of the normals are expected to be {sigma_deg:.0f} degrees off or more"
    assert [message.split(":")[0] for message in said] == [expected] * warned


@pytest.mark.parametrize("sigma", [None, np.inf])
def test_errors_that_a_method_does_not_know_are_not_told(capture, sigma):
    def unknown(prepared, options, progress):
        doubt = None if sigma is None else np.full(prepared.mask.shape, sigma)
        return replace(kept_depth(prepared), normal_sigma=doubt, depth_sigma=doubt)

    result = refine(capture, Method("unknown", unknown, Kept))
    assert result.expected_errors is None
    assert "normals-uncertain" not in [f.code for f in result.findings]


@dataclass(frozen=True)
class Kept:
    weight: float = 1.0


def kept_depth(prepared):
    count = len(prepared)
    return Estimate(
        log_depth=np.log(prepared.depth_m),
        albedo=np.ones((*prepared.mask.shape, 3)),
        confidence=np.zeros(prepared.mask.shape),
        lights=Lights(np.zeros((count, 1, 3)), np.ones((count, 1))),
        converged=True,
    )


def test_options_are_kept_with_the_result(capture):
    options = MultiLightAlternating(max_iterations=2, depth_weight=3.0)
    result = refine(capture, "multi-light-alternating", options=options)
    assert result.options == {
        "max_iterations": 2,
        "tolerance": MultiLightAlternating().tolerance,
        "depth_weight": 3.0,
        "min_photographs": 4,
    }
    assert result.iterations <= 2


@pytest.mark.parametrize("weight", [-1.0, np.nan])
def test_impossible_options(weight):
    with pytest.raises(InputError):
        MultiLightAlternating(depth_weight=weight)


def test_bad_scale(capture):
    with pytest.raises(InputError, match="resolution"):
        refine(capture, scale=3)


# ---- progress


def test_progress_is_told_in_rising_steps(capture):
    told = []
    result = refine(capture, "multi-light-alternating", progress=told.append)
    assert told[0].stage == "prepare"
    rounds = told[1:]
    assert {p.stage for p in rounds} == {"refine"}
    assert [p.step for p in rounds] == list(range(1, result.iterations + 1))
    assert {p.steps for p in rounds} == {MultiLightAlternating().max_iterations}
    assert tuple(p.energy for p in rounds) == result.energy[:-1]


def test_what_progress_raises_comes_through(capture, joint):
    class StopError(Exception):
        pass

    def stop(progress):
        if progress.step == 2:
            raise StopError

    with pytest.raises(StopError):
        refine(capture, progress=stop)
    np.testing.assert_array_equal(refine(capture).depth, joint.depth)


@pytest.mark.parametrize("error", [np.linalg.LinAlgError, ValueError])
def test_errors_of_progress_are_not_taken_for_the_solvers(capture, error):
    cause = KeyError("mine")

    def stop(progress):
        raise error("array must not contain infs or NaNs") from cause

    with pytest.raises(error, match=r"^array must not contain infs or NaNs$") as raised:
        refine(capture, progress=stop)
    assert type(raised.value) is error
    assert raised.value.__cause__ is cause


def test_an_error_of_progress_is_not_taken_for_the_methods():
    """One that is caught where a method takes no fewer photographs."""

    def stop(progress):
        raise MethodError("mine")

    def run():
        with coming_through(stop) as told, suppress(MethodError):
            told(Progress("refine"))

    with pytest.raises(MethodError, match="mine"):
        run()


def test_the_capture_is_not_changed(capture):
    before = [a.copy() for a in (capture.photographs, capture.depth_m, capture.mask)]
    for array in (capture.photographs, capture.depth_m, capture.mask):
        array.setflags(write=False)
    refine(capture)
    for array, copy in zip(
        (capture.photographs, capture.depth_m, capture.mask), before, strict=True
    ):
        np.testing.assert_array_equal(array, copy)


def test_the_same_capture_gives_the_same_result(capture, joint):
    again = refine(capture)
    np.testing.assert_array_equal(again.depth, joint.depth)
    assert again.energy == joint.energy


# ---- shared measures


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_confidence_is_one_half_at_three_degrees_of_doubt(noise):
    # Information 1 / sigma^2 in every direction: f / |m| turns a gradient into an angle.
    camera, length = Camera(1, 1, 50.0, 50.0, 0.0, 0.0), 1.7
    for doubt_deg, expected in ((3.0, 0.5), (1.0, 0.9), (9.0, 0.1)):
        information = (noise / np.radians(doubt_deg) * camera.fx / length) ** 2
        tensor = np.array([[information, 0.0, information]])
        found = photometric_confidence(tensor, noise, np.array([length]), camera)
        assert found[0] == pytest.approx(expected, rel=1e-9)


def test_confidence_counts_the_weakest_direction():
    camera = Camera(1, 1, 50.0, 50.0, 0.0, 0.0)
    angles = np.radians([0, 30, 90, 135])
    strong, weak = 1e6, 4.0
    tensor = np.stack(
        [
            strong * np.cos(angles) ** 2 + weak * np.sin(angles) ** 2,
            (strong - weak) * np.cos(angles) * np.sin(angles),
            strong * np.sin(angles) ** 2 + weak * np.cos(angles) ** 2,
        ],
        axis=-1,
    )
    even = photometric_confidence(np.array([[weak, 0.0, weak]]), 0.01, np.ones(1), camera)
    found = photometric_confidence(tensor, 0.01, np.ones(4), camera)
    np.testing.assert_allclose(found, even[0], rtol=1e-6)


def test_scatter_is_the_inverse_of_indexing():
    mask = np.random.default_rng(0).random((6, 7)) < 0.5
    for channels in ((), (3,)):
        values = np.random.default_rng(1).normal(size=(int(mask.sum()), *channels))
        image = scatter(values, mask)
        np.testing.assert_array_equal(image[mask], values)
        assert not image[~mask].any()


# ---- from folder to folder


def test_from_capture_folder_to_result_folder(scene, joint, tmp_path):
    capture, truth = scene
    write_capture(capture, tmp_path / "capture", truth=truth)
    again = load_capture(tmp_path / "capture")
    for name in ("photographs", "depth_m", "mask"):
        np.testing.assert_array_equal(getattr(again, name), getattr(capture, name))
    assert again.camera == capture.camera
    np.testing.assert_array_equal(load_truth(tmp_path / "capture").depth, truth.depth)
    assert tomllib.loads((tmp_path / "capture" / "capture.toml").read_text())["encoding"] == "srgb"

    result = rakelight.refine(again)
    np.testing.assert_array_equal(result.depth, joint.depth)
    save_result(result, tmp_path / "out")
    loaded = load_result(tmp_path / "out")
    np.testing.assert_array_equal(loaded.depth, result.depth)
    np.testing.assert_array_equal(loaded.normals, result.normals)
    np.testing.assert_array_equal(loaded.prepared_depth, result.prepared_depth)
    np.testing.assert_allclose(loaded.confidence, result.confidence, atol=0.5 / 255)
    assert loaded.method == result.method
    assert loaded.camera == result.camera


@pytest.mark.parametrize("name", METHODS)
def test_what_every_method_writes_of_several_photographs_is_read_back(capture, tmp_path, name):
    method = load_method(name)
    result = refine(replace(capture, lighting=method.lighting), name)
    save_result(result, tmp_path / "out", mesh="none")
    loaded = load_result(tmp_path / "out")
    assert loaded.photograph_names == capture.names[: len(result.lights)]
    np.testing.assert_array_equal(loaded.depth, result.depth)
    lights = json.loads((tmp_path / "out/lights.json").read_text())["photographs"]
    assert tuple(each["name"] for each in lights) == loaded.photograph_names


def test_methods_run_on_one_blas_thread_and_leave_the_number_as_it_was(capture):
    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    seen = []
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        refine(capture, progress=lambda step: seen.append((step.stage, threads())))
        assert threads() == before
    assert [found for stage, found in seen if stage != "prepare"] == [{1}] * (len(seen) - 1)
    assert len(seen) > 1
    assert before == {2}


@pytest.mark.parametrize("value", [np.nan, np.inf, 1000.0, -1000.0])
@pytest.mark.parametrize("from_depth", [False, True])
def test_pixels_that_a_method_gives_no_depth_are_left_out_and_counted(capture, value, from_depth):
    def patchy(prepared, options, progress):
        estimate = kept_depth(prepared)
        rows, columns = (slice(n // 2, n // 2 + 3) for n in prepared.mask.shape)
        assert prepared.mask[rows, columns].all()
        estimate.log_depth[rows, columns] = value
        return estimate

    result = refine(capture, Method("patchy", patchy, Kept, starts_from_depth=from_depth))
    sound = refine(capture, Method("kept", lambda prepared, *_: kept_depth(prepared), Kept))
    assert np.count_nonzero(result.mask) == np.count_nonzero(sound.mask) - 9
    assert np.isfinite(result.normals[result.mask]).all()
    (finding,) = (each for each in result.findings if each.code == "not-finite")
    assert "9 pixels" in finding.message
    assert (sound.converged, result.converged) == (True, False)


@pytest.mark.parametrize("from_depth", [False, True])
@pytest.mark.parametrize("field", ["albedo", "confidence", "lights"])
def test_what_else_a_method_gives_that_is_not_finite_is_told(capture, field, from_depth):
    def patchy(prepared, options, progress):
        estimate = kept_depth(prepared)
        values = estimate.lights.vector if field == "lights" else getattr(estimate, field)
        values[tuple(n // 2 for n in values.shape[:2])] = np.nan
        return estimate

    result = refine(capture, Method("patchy", patchy, Kept, starts_from_depth=from_depth))
    (finding,) = (each for each in result.findings if each.code == "not-finite")
    assert ("the lights" if field == "lights" else "1 pixels") in finding.message
    np.testing.assert_array_equal(result.mask, np.isfinite(result.prepared_depth))
    assert np.isfinite(result.albedo).all()
    assert np.isfinite(result.confidence).all()
    assert not result.converged


def test_a_method_that_gives_no_pixel_a_depth_is_refused(capture):
    def lost(prepared, options, progress):
        return replace(kept_depth(prepared), log_depth=np.full(prepared.mask.shape, np.nan))

    for from_depth in (False, True):
        with pytest.raises(InputError, match="no pixel has a finite depth and normal by lost"):
            refine(capture, Method("lost", lost, Kept, starts_from_depth=from_depth))


def of_two_photographs(estimate):
    return Lights(np.zeros((2, 1, 3)), np.zeros((2, 1)))


WRONG = {
    "estimate": (lambda estimate: None, "NoneType", "an Estimate"),
    "log_depth": (lambda estimate: np.zeros((3, 3)), r"float64 of shape \(3, 3\)", "numbers"),
    "albedo": (lambda estimate: estimate.confidence, r"float64 of shape", r"numbers of .*, 3\)"),
    "confidence": (lambda estimate: estimate.confidence + 200, "200", "0 to 1"),
    "normals": (lambda estimate: estimate.log_depth, "float64", r"numbers of .*, 3\)"),
    "depth_sigma": (lambda estimate: 0.1, "float", "numbers of shape"),
    "findings": (lambda estimate: [], "list", "a tuple of Finding"),
    "energy": (lambda estimate: None, "NoneType", "a tuple of numbers"),
    "steps": (lambda estimate: "x", "str", "a whole number"),
    "converged": (lambda estimate: "yes", "str", "True or False"),
    "timings_s": (lambda estimate: None, "NoneType", "a dict, name -> seconds"),
    "lights": (of_two_photographs, r"float64 of shape \(2, 1\)", r"numbers of shape \(5, 1\)"),
}


@pytest.mark.parametrize("from_depth", [False, True])
@pytest.mark.parametrize("field", WRONG)
def test_what_a_method_gives_back_has_to_be_an_estimate(capture, field, from_depth):
    make, seen, needed = WRONG[field]

    def wrong(prepared, options, progress):
        estimate = kept_depth(prepared)
        value = make(estimate)
        return value if field == "estimate" else replace(estimate, **{field: value})

    words = rf"wrong {field}.* from the method wrong .seen {seen}.*, needed {needed}"
    with pytest.raises(MethodError, match=words):
        refine(capture, Method("wrong", wrong, Kept, starts_from_depth=from_depth))


def test_a_methods_findings_are_notes_and_warnings(capture):
    def wrong(prepared, options, progress):
        return replace(kept_depth(prepared), findings=(Finding("error", "x", "y"),))

    words = "wrong findings from the method wrong .seen 'error', needed the severity 'note' or"
    with pytest.raises(MethodError, match=words):
        refine(capture, Method("wrong", wrong, Kept))


@dataclass(frozen=True)
class Needy:
    strength: float


@pytest.mark.parametrize("options", [dict, None, Needy, Kept()])
def test_a_methods_options_are_a_dataclass_of_defaults(options):
    with pytest.raises(MethodError, match=r"no options of the method mine .*every field with a"):
        Method("mine", lambda prepared, options, progress: kept_depth(prepared), options)


def test_a_method_without_a_function():
    with pytest.raises(MethodError, match=r"no function of the method mine .seen NoneType"):
        Method("mine", None, Kept)


def test_a_method_may_use_one_photograph_and_single_precision(capture):
    def brief(prepared, options, progress):
        estimate = kept_depth(prepared)
        return replace(
            estimate,
            log_depth=estimate.log_depth.astype(np.float32),
            confidence=np.full(prepared.mask.shape, np.float32(1 + 1e-7)),
            lights=Lights(np.zeros((1, 3, 3)), np.ones((1, 3))),
        )

    result = refine(capture, Method("brief", brief, Kept))
    assert len(result.lights) == 1
    assert result.converged
