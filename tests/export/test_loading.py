"""rakelight.load_result: the Result that was saved, and what is said of damaged folders."""

import json
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest

import rakelight
from rakelight.errors import InputError
from rakelight.export import load_result
from rakelight.model import FARTHEST_M, Lights, Result
from rakelight.photometry.forward import arriving
from rakelight.photometry.images import LightParameters
from tests.export.conftest import make_sphere

MIDDLE_M = np.array([0.01, -0.012, 0.62])


def full(sphere):
    """A result with every field."""
    sigma = np.where(sphere.mask, 0.001, np.nan).astype(np.float32)
    return replace(
        sphere,
        options={"depth_weight": None, "lights": "auto", "sizes": (1, 2)},
        energy=(9.0, float("nan"), 3.5),
        capture={
            **{"photographs": 2, "photograph_size": [64, 48], "bits": 16, "encoding": "linear"},
            **{"lighting": "moving-lamp", "depth_maps": 1, "depth_size": [32, 24]},
            "depth_checksum": "0123abcd",
        },
        prediction_errors=(0.02, 0.03),
        depth_sigma=sigma,
        normal_sigma=1000 * sigma,
    )


@pytest.fixture(scope="module")
def pristine(tmp_path_factory):
    """A result as it was, and its folder."""
    result, folder = full(make_sphere()), tmp_path_factory.mktemp("pristine") / "out"
    rakelight.save_result(result, folder, mesh="none")
    return result, folder


@pytest.fixture
def saved(pristine, tmp_path):
    """The same with a folder of the test's own."""
    return pristine[0], shutil.copytree(pristine[1], tmp_path / "out")


def test_every_field_comes_back(saved):
    result, folder = saved
    again = rakelight.load_result(folder)
    assert isinstance(again, Result)
    exact = {"depth", "normals", "prepared_depth", "depth_sigma", "normal_sigma"}
    rounded = {"albedo": 2e-5, "confidence": 0.5 / 255 + 1e-6}
    for name in exact:
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    for name, off in rounded.items():
        clipped = np.minimum(getattr(result, name), 1)
        np.testing.assert_allclose(getattr(again, name), clipped, rtol=0, atol=off)
    maps = exact | set(rounded)
    assert {getattr(again, name).dtype for name in maps} == {np.dtype(np.float32)}
    np.testing.assert_allclose(again.lights.vector, result.lights.vector, rtol=1e-15)
    np.testing.assert_array_equal(again.lights.ambient, result.lights.ambient)
    assert again.lights.position_m is None
    assert again.options == {"depth_weight": None, "lights": "auto", "sizes": [1, 2]}
    assert again.energy == pytest.approx((9.0, float("nan"), 3.5), rel=0, nan_ok=True)
    others = {f.name for f in fields(Result)} - maps - {"lights", "options", "energy"}
    assert len(others) == 10
    for name in others:
        assert getattr(again, name) == getattr(result, name), name


def test_what_was_brighter_than_white_is_clipped(sphere, tmp_path):
    bright = replace(sphere, albedo=3 * sphere.albedo)
    rakelight.save_result(bright, tmp_path / "out", mesh="none")
    again = rakelight.load_result(tmp_path / "out")
    assert bright.albedo.max() > 1.5
    assert again.albedo.max() == 1.0
    dim = bright.albedo < 1
    np.testing.assert_allclose(again.albedo[dim], bright.albedo[dim], rtol=0, atol=2e-5)


def test_a_loaded_result_is_written_as_it_was(saved, tmp_path):
    _, folder = saved
    rakelight.save_result(load_result(folder), tmp_path / "again", mesh="none")
    rounded = {"lights.json", "report.html"}
    for name in {path.name for path in folder.iterdir()} - rounded - {"result.json"}:
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name
    said = [json.loads((each / "result.json").read_text()) for each in (folder, tmp_path / "again")]
    for summary in said:
        assert all(summary["checksums"].pop(name) for name in rounded)
    assert said[0] == said[1]


def test_near_lights_and_a_distant_one_among_them(sphere, tmp_path):
    direction = np.array([[0.6, 0.0, -0.8], [0.0, 0.6, -0.8]])[:, None]
    distance_m = np.array([0.5, FARTHEST_M])[:, None, None]
    lights = Lights(
        vector=2.0 * direction,
        ambient=np.array([[0.1], [0.2]]),
        position_m=MIDDLE_M + distance_m * direction,
        middle_m=MIDDLE_M,
    )
    rakelight.save_result(replace(sphere, lights=lights), tmp_path / "out", mesh="none")
    again = rakelight.load_result(tmp_path / "out").lights
    np.testing.assert_allclose(again.position_m, lights.position_m, rtol=1e-12)
    np.testing.assert_allclose(again.middle_m, MIDDLE_M, rtol=0)
    np.testing.assert_allclose(again.distance_m, [[0.5], [np.inf]])
    np.testing.assert_allclose(again.vector, lights.vector, rtol=1e-12)


def test_lights_as_a_method_makes_them(sphere, tmp_path):
    white = np.array([[[0.0, -0.6, -0.8]], [[1.2, 0.0, -1.6]]])
    coloured = white * np.array([1.0, 0.9, 0.8])[:, None]
    nearness = np.array([[2.0] * 3, [0.0] * 3])
    lights = LightParameters(coloured, np.full((2, 3), 0.1), nearness).as_lights(MIDDLE_M)
    rakelight.save_result(replace(sphere, lights=lights), tmp_path / "out", mesh="none")
    again = rakelight.load_result(tmp_path / "out").lights
    assert again.vector.shape == (2, 3, 3)
    np.testing.assert_allclose(again.vector, lights.vector, rtol=1e-12)
    np.testing.assert_allclose(again.position_m, lights.position_m, rtol=1e-9)


@pytest.mark.parametrize("near", [True, False])
def test_lights_with_beams(sphere, tmp_path, near):
    white, rng = np.array([[[0.0, -0.6, -0.8]], [[1.2, 0.0, -1.6]]]), np.random.default_rng(0)
    beam = rng.uniform([-5, -5, 0], [5, 5, 30], (2, 1, 3))
    nearness = np.full((2, 1), 2.0 if near else 0.0)
    lights = LightParameters(white, np.full((2, 1), 0.1), nearness, beam=beam).as_lights(MIDDLE_M)
    rakelight.save_result(replace(sphere, lights=lights), tmp_path / "out", mesh="none")
    again = rakelight.load_result(tmp_path / "out").lights
    np.testing.assert_allclose(again.beam, beam, rtol=1e-9)
    np.testing.assert_allclose(again.middle_m, MIDDLE_M, rtol=0)
    assert (again.position_m is not None) == near
    points = MIDDLE_M + rng.normal(0, 0.05, (20, 3))
    np.testing.assert_allclose(arriving(again, points), arriving(lights, points), rtol=1e-9)
    one = again.of(1)
    np.testing.assert_allclose(arriving(one, points)[0], arriving(lights, points)[1], rtol=1e-9)


@pytest.mark.parametrize("kind", ["distant", "near", "beam"])
def test_ambient_light_from_one_side(sphere, tmp_path, kind):
    white = np.array([[[0.0, -0.6, -0.8]], [[1.2, 0.0, -1.6]]])
    nearness = np.full((2, 1), 2.0 if kind == "near" else 0.0)
    beam = np.ones((2, 1, 3)) if kind == "beam" else None
    direction = np.array([0.5, -0.25, -1.0])
    lights = LightParameters(
        white, np.full((2, 1), 0.1), nearness, beam=beam, ambient_direction=direction
    ).as_lights(MIDDLE_M)
    rakelight.save_result(replace(sphere, lights=lights), tmp_path / "out", mesh="none")
    again = rakelight.load_result(tmp_path / "out").lights
    np.testing.assert_array_equal(again.ambient_direction, direction)
    assert (again.position_m is not None) == (kind == "near")
    assert (again.beam is not None) == (kind == "beam")
    facing = np.array([[0.0, 0.0, -1.0], [0.6, 0.8, 0.0]])
    np.testing.assert_allclose(again.of(1).ambient_on(facing)[0, :, 0], [0.2, 0.11], rtol=1e-12)


@pytest.mark.parametrize("part", ["position_m", "beam", "middle_m"])
def test_places_and_beams_need_the_middle_they_are_about(part):
    facing, value = np.array([[[0.0, 0.0, -1.0]]]), np.zeros((1, 1, 3))
    with pytest.raises(InputError, match=r"positions or beams .*(no middle_m|middle_m alone)"):
        Lights(facing, np.zeros((1, 1)), **{part: value[0, 0] if part == "middle_m" else value})


FILES = [
    *("depth.tiff", "normals.tiff", "prepared_depth.tiff", "albedo.png", "confidence.png"),
    *("lights.json", "depth_sigma.tiff", "normal_sigma.tiff", "result.json"),
]


@pytest.mark.parametrize("fault", ["missing", "empty", "cut", "another", "a folder"])
@pytest.mark.parametrize("name", FILES)
def test_faulty_files_are_named_with_what_is_needed(saved, name, fault):
    _, folder = saved
    path = folder / name
    data = path.read_bytes()
    path.unlink()
    if fault == "empty":
        path.write_bytes(b"")
    elif fault == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif fault == "another":
        path.write_bytes((folder / "depth.png").read_bytes())
    elif fault == "a folder":
        path.mkdir()
    with pytest.raises(InputError) as refused:
        rakelight.load_result(folder)
    line = str(refused.value)
    whole = name == "result.json" and fault in ("missing", "a folder")
    assert line.startswith(f"{folder if whole else path}: "), line
    assert "needed " in line
    assert ". Fix: " in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lights: lights.pop("photographs"), "not a lights.json"),
        (lambda lights: lights["photographs"].clear(), "seen no photograph"),
        (lambda lights: lights["photographs"].pop(), "seen 1 photographs, needed 2"),
        (lambda lights: lights.update(schema="rakelight-lights/2"), "of another version"),
        (lambda lights: lights["photographs"][0]["channels"].update(green={}), "not a lights.json"),
        (lambda lights: channel(lights).update(direction=[1, 2]), "not a lights.json"),
        (lambda lights: channel(lights).update(intensity="1"), "not a lights.json"),
        (lambda lights: lights["photographs"][0].update(channels={}), "white or red/green/blue"),
        (lambda lights: lights.update(middle_m=[1, 2]), "not a lights.json"),
    ],
)
def test_lights_that_do_not_fit(saved, change, words):
    _, folder = saved
    lights = json.loads((folder / "lights.json").read_text())
    change(lights)
    (folder / "lights.json").write_text(json.dumps(lights))
    with pytest.raises(InputError, match=words) as refused:
        rakelight.load_result(folder)
    assert refused.value.source == str(folder / "lights.json")
    assert refused.value.needed


def channel(lights):
    return lights["photographs"][0]["channels"]["white"]


def test_lights_that_were_not_finite_are_nan(saved):
    _, folder = saved
    lights = json.loads((folder / "lights.json").read_text())
    channel(lights).update(intensity=None, ambient=None)
    (folder / "lights.json").write_text(json.dumps(lights))
    again = rakelight.load_result(folder).lights
    assert np.isnan(again.vector[0]).all()
    assert np.isfinite(again.vector[1]).all()


def test_a_method_without_expected_errors(sphere, tmp_path):
    rakelight.save_result(sphere, tmp_path / "out", mesh="none")
    again = rakelight.load_result(str(tmp_path / "out"))
    assert again.depth_sigma is again.normal_sigma is None


@pytest.mark.parametrize("thing", [None, "out", np.ones((2, 2))])
def test_what_is_no_result_is_not_saved(tmp_path, thing):
    with pytest.raises(InputError, match=r"no Result .*Fix: give what rakelight\.refine"):
        rakelight.save_result(thing, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
