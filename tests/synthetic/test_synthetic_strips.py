"""Rendering in strips: the values of rendering at once, and none of its memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from rakelight.capture import load_capture, load_truth, write_capture
from rakelight.capture.images import encode_png
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean
from rakelight.model import Camera, RigidTransform
from rakelight.synthetic import (
    ALBEDOS,
    DepthNoise,
    SceneOptions,
    make_albedo,
    make_relief,
    make_shape,
    render_scene,
    rendering,
    shape_from_depth,
    texture_from_file,
    write_scene,
)
from rakelight.synthetic.quantile import count_values, quantile
from rakelight.synthetic.shapes import VIEW
from tests.synthetic.at_once import render_at_once

SMALL = VIEW.scaled(0.1)  # 48 x 36
OFF_CENTRE = Camera(48, 36, fx=90.3, fy=91.7, cx=25.123, cy=7.777)
BESIDE = RigidTransform(np.eye(3), np.array([0.05, 0.0, 0.0]))
NOISE = DepthNoise(rms_mm=2.5, correlation_length_px=3.0, step_mm=1.0, hole_fraction=0.1)


def relief_from_a_map():
    """A depth map, as scans are, of a sphere."""
    camera = VIEW.scaled(0.2)
    return shape_from_depth("map", make_shape("sphere").render(camera).depth, camera)


SHAPES = {
    "coin": lambda: make_shape("coin"),
    "sphere": lambda: make_shape("sphere"),
    "map": relief_from_a_map,
}
SCENES = {
    "plain": ("coin", {"depth_factor": 2, "depth_noise": NOISE}),
    "exposures": ("map", {"exposure_spread": 0.5, "peak_quantile": 0.8, "depth_factor": 1.7}),
    "cast shadows": ("coin", {"cast_shadows": True, "tilt_deg": (50, 70), "supersampling": 1}),
    "near and shiny": ("map", {"lamp_distance_m": 0.4, "specular": 0.5, "ambient": 0.3}),
    "all at once": (
        "sphere",
        {"cast_shadows": True, "lamp_distance_m": 0.3, "specular": 0.5, "supersampling": 3},
    ),
    "leds": ("sphere", {"lighting": "rgb-leds", "specular": 0.2, "bits": 8, "encoding": "srgb"}),
    "daylight": ("map", {"lighting": "ambient", "exposure": 0.6, "encoding": "srgb"}),
    "own depth camera": (
        "sphere",
        {"depth_to_color": BESIDE, "depth_factor": 3, "depth_frames": 2, "depth_noise": NOISE},
    ),
    "off centre": ("sphere", {"camera": OFF_CENTRE, "supersampling": 1, "bits": 8}),
}


def in_strips(monkeypatch, rows, options):
    """From now on strips of a scene have about so many rows."""
    rays = options.camera.width * options.supersampling**2
    monkeypatch.setattr(rendering, "SAMPLES", rows * rays)


def arrays(capture, truth):
    lights = {name: getattr(truth.lights, name) for name in ("vector", "ambient", "position_m")}
    images = {name: getattr(capture, name) for name in ("photographs", "depth_m", "mask")}
    maps = {name: getattr(truth, name) for name in ("depth", "normals", "albedo")}
    return {**images, **maps, **lights}


def assert_same(found, expected):
    """Same type, shape and bits; NaN included."""
    for name, values in expected.items():
        if values is None:
            assert found[name] is None
        else:
            assert found[name].dtype == values.dtype, name
            np.testing.assert_array_equal(found[name], values, err_msg=name)


@pytest.mark.parametrize("name", SCENES)
def test_strips_have_the_values_of_the_whole(name, monkeypatch):
    shape, changes = SCENES[name]
    shape, paint = SHAPES[shape](), make_albedo("pattern")
    options = SceneOptions(**{"camera": SMALL, "photographs": 3, "seed": 4, **changes})
    whole = render_at_once(shape, paint, options)
    for rows in (36, 11, 4):
        in_strips(monkeypatch, rows, options)
        assert_same(arrays(*render_scene(shape, paint, options)), whole)


@pytest.mark.parametrize("rows", [slice(0, 5), slice(11, 12), slice(13, 36)])
def test_rows_of_a_shape_are_those_of_its_whole(rows):
    for shape in (make_shape("coin"), make_relief("ring"), make_relief("stone")):
        camera = OFF_CENTRE if shape.solid else shape.camera.scaled(0.2)
        whole, part = shape.render(camera), shape.render(camera, rows)
        np.testing.assert_array_equal(part.depth, whole.depth[rows])
        np.testing.assert_array_equal(part.normals, whole.normals[rows])
        points = back_project(whole.depth, camera)[rows]
        np.testing.assert_array_equal(back_project(part.depth, camera, rows), points)


@pytest.mark.parametrize("name", [*ALBEDOS, "texture"])
def test_rows_of_a_paint_are_those_of_its_whole(name, tmp_path):
    if name == "texture":
        texture = np.random.default_rng(0).integers(0, 255, (90, 70, 3), np.uint8)
        (tmp_path / "texture.png").write_bytes(encode_png(texture))
        albedo = texture_from_file(tmp_path / "texture.png")
    else:
        albedo = make_albedo(name, 3)
    whole = albedo.paint(SMALL)
    for rows in (slice(0, 5), slice(11, 12), slice(13, 36)):
        np.testing.assert_array_equal(albedo.paint(SMALL, rows), whole[rows])


@pytest.mark.parametrize(("bits", "noise"), [(8, 0.01), (16, 0.01), (16, 0.0)])
def test_a_scene_that_is_written_is_the_one_that_is_rendered(bits, noise, monkeypatch, tmp_path):
    ball, paint = make_shape("sphere"), make_albedo("pattern")
    options = SceneOptions(
        camera=SMALL, photographs=3, bits=bits, image_noise=noise, depth_factor=2, lamp_distance_m=1
    )
    in_strips(monkeypatch, 10, options)
    _, findings = write_scene(ball, paint, options, tmp_path / "made")
    read, known = load_capture(tmp_path / "made"), load_truth(tmp_path / "made")
    assert findings == ()
    assert_same(arrays(read, known), arrays(*render_scene(ball, paint, options)))
    assert (read.camera, read.names) == (SMALL, ("000.png", "001.png", "002.png"))


def peak_bytes(work):
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def growth(make, monkeypatch, tmp_path):
    """By how many 8-bit photographs the peak grows where there are twenty more of them.

    One strip at a time: how many are at work at once is a matter of the threads' timing.
    """
    monkeypatch.setattr(rendering, "_on_all_cores", map)
    sphere, peaks = make_shape("sphere"), []
    quiet = SceneOptions(camera=VIEW.scaled(0.4), supersampling=1, exposure=0.6, bits=8)
    for count in (2, 2, 22):  # the first loads the modules
        options = replace(quiet, photographs=count, depth_factor=4)
        in_strips(monkeypatch, 16, options)
        folder = tmp_path / f"{make.__name__}-{len(peaks)}"
        peaks.append(peak_bytes(lambda o=options, f=folder: make(sphere, o, f)))
    return (peaks[2] - peaks[1]) / (3 * 192 * 144)


def at_once(shape, options, folder):
    capture, truth = render_scene(shape, make_albedo("grey"), options)
    write_capture(capture, folder, truth=truth)


def by_and_by(shape, options, folder):
    write_scene(shape, make_albedo("grey"), options, folder)


def test_memory_does_not_grow_with_the_photographs(monkeypatch, tmp_path):
    assert growth(by_and_by, monkeypatch, tmp_path) < 1
    assert growth(at_once, monkeypatch, tmp_path) > 9


def test_an_interrupt_leaves_nothing(tmp_path):
    def interrupt(now):
        if (now.stage, now.step) == ("photographs", 2):
            raise KeyboardInterrupt

    options = SceneOptions(camera=SMALL, photographs=3, supersampling=1)
    with pytest.raises(KeyboardInterrupt):
        write_scene(
            make_shape("sphere"), make_albedo("grey"), options, tmp_path / "out", progress=interrupt
        )
    assert list(tmp_path.iterdir()) == []


def test_progress_moves_with_every_strip_and_photograph(monkeypatch, tmp_path):
    seen = []
    options = SceneOptions(camera=SMALL, photographs=3, supersampling=1)
    in_strips(monkeypatch, 8, options)
    write_scene(
        make_shape("sphere"), make_albedo("grey"), options, tmp_path / "out", progress=seen.append
    )
    stages = list(dict.fromkeys(now.stage for now in seen))
    assert stages == ["surface", "exposure", "photographs"]
    for stage, steps in (("surface", 5), ("exposure", 5), ("photographs", 3)):
        assert {now.steps for now in seen if now.stage == stage} == {steps}
        assert len({now.step for now in seen if now.stage == stage}) == steps


@pytest.mark.parametrize("share", [1e-9, 0.123456, 0.5, 0.995, 1.0])
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (37, 29)])
def test_a_quantile_is_numpys_to_the_last_digit(size, share):
    random = np.random.default_rng(1)
    light = random.random((*size, 3), np.float32) * 10.0 ** random.integers(-9, 4, (*size, 3))
    light = light.astype(np.float32)
    light[random.random(light.shape) < 0.3] = 0.25
    mask = random.random(size) < 0.7
    mask[0, 0] = True
    found = quantile(lambda upper: count_values(light, mask, upper), share)
    assert found == np.quantile(light[mask], share)


def test_depth_of_a_multiple_of_rows_is_the_mean_of_them(monkeypatch):
    sphere, camera = make_shape("sphere"), VIEW.scaled(0.25)
    options = SceneOptions(camera=camera, photographs=1, supersampling=1, depth_factor=15)
    in_strips(monkeypatch, 4, options)
    capture, _ = render_scene(sphere, make_albedo("grey"), options)
    expected = area_mean(sphere.render(camera).depth, 15).astype(np.float32)
    np.testing.assert_array_equal(capture.depth_m[0], expected)
