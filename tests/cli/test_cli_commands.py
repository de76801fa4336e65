"""What the commands do when all is well: refine's choices, synth, eval, demo."""

import json
import re
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from rakelight.capture import load_capture, load_truth
from rakelight.capture.images import decode_image, encode_png, encode_tiff
from rakelight.export import load_result
from rakelight.export.mesh_formats import MESH_CHOICES
from rakelight.geometry.normals import surface_normals
from rakelight.methods import METHODS
from rakelight.metrics import evaluate_maps
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.cli.cli_helpers import QUICK, contents, small_scene

REAL_CAPTURES = Path(__file__).resolve().parents[3] / "shared" / "captures"


# --- refine: its choices ---


def test_photographs_chosen(run, capture, tmp_path):
    command = ("refine", capture, *QUICK, "-o")
    ran = run(*command, tmp_path / "chosen", "--photographs", "0-2, 3", "--json")
    assert json.loads(ran.out)["photographs"] == 4
    stored = json.loads((tmp_path / "chosen" / "result.json").read_text())
    assert stored["photographs"] == ["000.png", "001.png", "002.png", "003.png"]
    (capture / "rgb" / "004.png").unlink()
    assert run(*command, tmp_path / "only", "--quiet").code == 0
    for name in ("depth.tiff", "albedo.png", "lights.json"):
        chosen, only = (tmp_path / out / name for out in ("chosen", "only"))
        assert chosen.read_bytes() == only.read_bytes()


def test_photographs_that_are_not_chosen_are_not_looked_at(run, capture, tmp_path):
    # The last is the first again, and the one before shows nothing: neither counts.
    rgb = capture / "rgb"
    (rgb / "006.png").write_bytes((rgb / "000.png").read_bytes())
    black = np.zeros_like(load_capture(capture, [3]).photographs[0])
    (rgb / "005.png").write_bytes(encode_png(black))
    assert run("refine", capture, "-o", tmp_path / "all").code == 2
    ran = run("refine", capture, "-o", tmp_path / "out", "--photographs", "0-4", "--json", *QUICK)
    assert ran.code == 0
    assert "005.png" not in ran.out


def test_photographs_in_another_order(run, capture, tmp_path):
    command = ("refine", capture, "-o", tmp_path / "out", "--photographs", "4,0-2", *QUICK)
    assert run(*command).code == 0
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    assert stored["photographs"] == ["004.png", "000.png", "001.png", "002.png"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("not a list", "needed numbers and ranges as 0-14,17")),
        ("first", ("not a list", "seen 'first'")),
        ("3-1", ("not a list", "seen '3-1'")),
        ("1-", ("not a list", "seen '1-'")),
        ("-1", ("not a list",)),
        ("0..3", ("not a list",)),
        ("0,1,", ("not a list",)),
        ("0-5", ("no such photographs", "needed numbers from 0 to 4")),
        ("0-99999", ("no such photographs", "seen number 5")),
        ("0-999999999999999999", ("not a list",)),
        ("9" * 5000, ("not a list",)),
        ("0-3,2", ("a photograph twice", "needed different numbers")),
    ],
)
def test_photographs_that_are_none(refused, capture, tmp_path, text, words):
    command = ("refine", capture, "-o", tmp_path / "out", f"--photographs={text}")
    about = "photographs" if words[0] == "no such photographs" else "--photographs"
    refused(*command, about=about, words=words)


@pytest.mark.parametrize("text", ["", "x", "1.5", "-1", "9" * 5000])
def test_scales_that_are_none(refused, capture, tmp_path, text):
    command = ("refine", capture, "-o", tmp_path / "out", f"--scale={text}")
    refused(*command, about="--scale", words=("not a scale", "needed auto or a whole number"))


@pytest.mark.parametrize("scale", ["0", "3", "4"])
def test_scales_that_the_camera_does_not_have(refused, capture, tmp_path, scale):
    command = ("refine", capture, "-o", tmp_path / "out", "--scale", scale)
    refused(*command, about=f"scale {scale}", words=("needed one of 1, 2",))


@pytest.mark.parametrize(("scale", "shape"), [("auto", (36, 48)), ("2", (36, 48)), ("1", (18, 24))])
def test_scale(run, capture, tmp_path, scale, shape):
    assert run("refine", capture, "-o", tmp_path / "out", "--scale", scale, *QUICK).code == 0
    assert load_result(tmp_path / "out").depth.shape == shape


@pytest.mark.parametrize("mesh", MESH_CHOICES)
def test_mesh(run, capture, tmp_path, mesh):
    assert run("refine", capture, "-o", tmp_path / "out", "--mesh", mesh, *QUICK).code == 0
    meshes = [path.name for path in (tmp_path / "out").glob("mesh.*")]
    assert meshes == ([] if mesh == "none" else [f"mesh.{mesh}"])


def test_normal_map(run, capture, tmp_path):
    for axes in ("opengl", "directx"):
        command = ("refine", capture, "-o", tmp_path / axes, "--normal-map", axes, *QUICK)
        assert run(*command).code == 0
    opengl, directx = (
        decode_image((tmp_path / axes / "normals.png").read_bytes()).astype(int)
        for axes in ("opengl", "directx")
    )
    mask = load_capture(capture).mask
    np.testing.assert_array_equal(opengl[mask][:, [0, 2]], directx[mask][:, [0, 2]])
    assert np.abs(opengl[mask][:, 1] + directx[mask][:, 1] - 255).max() <= 1
    top = mask.copy()
    top[14:] = False  # the sphere's upper part faces up: green is bright in OpenGL's map
    assert opengl[top][:, 1].min() > 128 > directx[top][:, 1].max()


def test_every_method_can_be_named(run, capture, tmp_path):
    for method in METHODS:
        out = tmp_path / method
        ran = run("refine", capture, "-o", out, "--method", method, "--scale", "1", "--json")
        if ran.code == 0:
            assert json.loads(ran.out)["method"] == method
        else:  # it is for another kind of capture, and says so
            assert (ran.code, ran.err.count("\n")) == (2, 1)
            assert method in ran.err


@pytest.mark.parametrize("method", ["", "Auto", "photometric"])
def test_an_unknown_method(run, capture, tmp_path, method):
    ran = run("refine", capture, "-o", tmp_path / "out", "--method", method)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"error: method {method!r} is unknown (needed one of ")
    for known in METHODS:
        assert known in ran.err
    assert not (tmp_path / "out").exists()


# --- refine: one photograph ---


@pytest.mark.parametrize("name", ["android", "monkey"])
def test_real_captures_of_one_photograph(run, tmp_path, name):
    folder = REAL_CAPTURES / name
    if not folder.is_dir():
        pytest.skip("the real captures are not here")
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    capture = load_capture(folder)
    assert len(capture.photographs) == 1
    assert capture.mask.any()
    ran = run("refine", folder, "-o", tmp_path / "out", "--method", "multi-light")
    assert (ran.code, ran.out) == (2, "")
    assert "seen 1, needed at least 3" in ran.err
    assert list(tmp_path.iterdir()) == []
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


# --- synth ---

SETTINGS = {
    "--lights": ("photographs", 4),
    "--supersampling": ("supersampling", 3),
    "--cone": ("tilt_deg", (20.0, 50.0)),
    "--lamp-distance": ("lamp_distance_m", 0.7),
    "--ambient": ("ambient", 0.2),
    "--specular": ("specular", 0.3),
    "--specular-exponent": ("specular_exponent", 20.0),
    "--exposure-spread": ("exposure_spread", 0.1),
    "--exposure": ("exposure", 0.8),
    "--image-noise": ("image_noise", 0.02),
    "--bits": ("bits", 8),
    "--encoding": ("encoding", "srgb"),
    "--depth-factor": ("depth_factor", 3),
    "--depth-frames": ("depth_frames", 2),
    "--seed": ("seed", 5),
}
NOISE = {
    "--depth-noise": ("rms_mm", 1.5),
    "--depth-correlation": ("correlation_length_px", 2.0),
    "--depth-step": ("step_mm", 1.0),
    "--holes": ("hole_fraction", 0.1),
}


def assert_reads_back(folder, capture, truth):
    """The folder holds this capture and truth, bit for bit."""
    read, known = load_capture(folder), load_truth(folder)
    for name in ("photographs", "depth_m", "mask"):
        seen, expected = getattr(read, name), getattr(capture, name)
        assert seen.dtype == expected.dtype
        np.testing.assert_array_equal(seen, expected, err_msg=name)
    assert (read.camera, read.encoding, read.lighting) == (
        capture.camera,
        capture.encoding,
        capture.lighting,
    )
    for name in ("depth", "normals", "albedo"):
        np.testing.assert_array_equal(getattr(known, name), getattr(truth, name), err_msg=name)
    for name in ("vector", "ambient", "position_m", "middle_m"):
        seen, expected = getattr(known.lights, name), getattr(truth.lights, name)
        np.testing.assert_array_equal(seen, expected, err_msg=name)


def test_synth_with_every_option(run, tmp_path):
    options = []
    for option, (_, value) in {**SETTINGS, **NOISE}.items():
        options += [option, *map(str, value if isinstance(value, tuple) else [value])]
    command = ("synth", tmp_path / "made", "--shape", "coin", "--albedo", "complicated")
    ran = run(*command, "--size", "0.15", "--cast-shadows", *options, "--json")
    assert json.loads(ran.out)["photographs"] == 4
    coin = make_shape("coin")
    scene = SceneOptions(
        camera=coin.camera.scaled(0.15),
        cast_shadows=True,
        depth_noise=DepthNoise(**dict(NOISE.values())),
        **dict(SETTINGS.values()),
    )
    assert_reads_back(tmp_path / "made", *render_scene(coin, make_albedo("complicated", 5), scene))


def test_synth_by_default(run, tmp_path):
    assert run("synth", tmp_path / "made", "--size", "0.1").code == 0
    vase = make_shape("vase")
    scene = SceneOptions(
        camera=vase.camera.scaled(0.1), depth_factor=2, depth_noise=DepthNoise(2.5, 6.0)
    )
    assert_reads_back(tmp_path / "made", *render_scene(vase, make_albedo("pattern"), scene))


def test_synth_counts_one_photograph_as_one(run, tmp_path):
    ran = run("synth", tmp_path / "made", "--size", "0.1", "--lighting", "ambient")
    assert ran.out == f"capture: {tmp_path / 'made'}  (1 photograph)\n"


def test_synth_with_a_depth_camera_beside(run, tmp_path):
    made, out = tmp_path / "made", tmp_path / "out"
    options = ("--baseline", "0.04", "--depth-factor", "1.7", "--lights", "6")
    assert run("synth", made, "--size", "0.15", *options).code == 0
    capture = load_capture(made)
    np.testing.assert_array_equal(capture.depth_to_color.translation_m, [0.04, 0, 0])
    assert capture.depth_m.shape[2] == round(capture.camera.width / 1.7)
    assert run("refine", made, "-o", out).code == 0
    scores = json.loads(run("eval", out, "--truth", made, "--json").out)
    assert scores["refined"]["normals"]["mae_deg"] < 0.7 * scores["prepared"]["normals"]["mae_deg"]
    assert run("synth", tmp_path / "no", "--baseline", "40").code == 2


def test_synth_then_refine_then_eval(run, tmp_path):
    made, out = tmp_path / "made", tmp_path / "out"
    assert run("synth", made, "--size", "0.1", "--lights", "8").code == 0
    assert run("refine", made, "-o", out).code == 0
    scores = json.loads(run("eval", out, "--truth", made, "--json").out)
    before, after = (scores[key]["normals"]["mae_deg"] for key in ("prepared", "refined"))
    assert after < 0.8 * before


@pytest.mark.parametrize(
    ("options", "about", "words"),
    [
        (["--shape", "dog"], "--shape", "needed one of head, vase"),
        (["--albedo", "mud"], "--albedo", "needed one of simple"),
        (["--size", "0"], "--size", "needed above 0"),
        (["--size", "nan"], "--size", "needed above 0"),
        (["--size", "1000000"], "--size", "needed above 0, up to 16"),
        (["--lights", "0"], "--lights", "needed a whole number from 1"),
        (["--lights", "1000000000"], "--lights", "needed a whole number from 1 to 10000"),
        (["--lights", "9" * 30], "--lights", "needed a whole number from 1 to 10000"),
        (["--supersampling", "1000000"], "--supersampling", "needed a whole number from 1 to 64"),
        (["--depth-frames", "1000000000"], "--depth-frames", "a whole number from 1 to 10000"),
        (["--cone", "40", "12"], "--cone", "needed two angles"),
        (["--lighting", "disco"], "--lighting", "needed moving-lamp, rgb-leds or ambient"),
        (["--bits", "12"], "--bits", "needed 8 or 16"),
        (["--depth-factor", "0.5"], "--depth-factor", "needed 1 to 100"),
        (["--depth-factor", "100", "--size", "0.2"], "--depth-factor", "seen 100, 1 x 1 depth"),
        (["--depth-noise", "-1"], "--depth-noise", "needed 0 to 10000"),
        (["--depth-correlation", "1e9"], "--depth-correlation", "needed 0 to 10000"),
        (["--exposure", "1e300"], "--exposure", "needed above 0, at most a million"),
        (["--exposure-spread", "1e5"], "--exposure-spread", "needed 0 to 10"),
        (["--depth-factor", "1e300", "--baseline", "0.1"], "--depth-factor", "needed 1 to 100"),
        (["--holes", "1"], "--holes", "(seen 1.0, needed below 1)"),
        (["--size", "0.001"], "vase", "(seen 0 x 0 pixels, needed at least one that lies on it"),
        (["--seed", "-1"], "--seed", "needed at least 0"),
        (["--lights", "5", "--lighting", "rgb-leds"], "--lights", "only a moving lamp has that"),
        (["--cone", "5", "9", "--lighting", "ambient"], "--cone", "only a moving lamp has that"),
        (["--shape-file", "none.npz"], "none.npz", "cannot be read"),
        (["--texture", "none.png"], "none.png", "cannot be read"),
        (
            ["--shape", "vase", "--shape-file", "none.npz"],
            "--shape and --shape-file",
            "(seen vase and none.npz, needed --shape or --shape-file)",
        ),
        (
            ["--albedo", "white", "--texture", "none.png"],
            "--albedo and --texture",
            "(seen white and none.png, needed --albedo or --texture)",
        ),
    ],
)
def test_synth_names_the_option_that_is_wrong(run, tmp_path, monkeypatch, options, about, words):
    monkeypatch.chdir(tmp_path)
    ran = run("synth", "out", *options)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"error: {about}: ")
    assert ran.err.count("\n") == 1
    assert words in ran.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("depth", "options", "words"),
    [
        (None, ["--size", "0.2", "--holes", "0.999"], ("almost no depth on the", "fewer holes")),
        (np.full((30, 30), 0.7, np.float32), [], ("fx' is implausible", "of more pixels")),
    ],
)
def test_synth_writes_nothing_that_cannot_be_read(run, tmp_path, depth, options, words):
    if depth is not None:
        (tmp_path / "plate.tiff").write_bytes(encode_tiff(depth))
        options = ["--shape-file", tmp_path / "plate.tiff"]
    ran = run("synth", tmp_path / "out", "--lights", "3", *options)
    assert (ran.code, ran.out, ran.err.count("\n")) == (2, "", 1)
    assert ran.err.startswith(f"error: {tmp_path / 'out'}: this scene makes no capture that")
    assert all(word in ran.err for word in words), ran.err
    assert not (tmp_path / "out").exists()


def test_synth_replaces_only_what_it_wrote(run, refused, capture, tmp_path):
    command = ("synth", capture, "--size", "0.1", "--lights", "3")
    refused(*command, about=capture, words=("the folder exists", "--overwrite"))
    assert run(*command, "--overwrite").code == 0
    assert len(load_capture(capture).photographs) == 3
    (capture / "rakelight-files.json").unlink()  # now it is like somebody's real capture
    refused(*command, "--overwrite", about=capture, words=("not overwritten",))


# --- eval ---


def scores_of(result, truth):
    """(prepared, refined) as rakelight.metrics finds them."""
    loaded, known = load_result(result), load_truth(truth)
    prepared_normals = surface_normals(loaded.prepared_depth, known.mask, loaded.camera)
    return (
        evaluate_maps(loaded.prepared_depth, prepared_normals, known),
        evaluate_maps(loaded.depth, loaded.normals, known),
    )


def test_eval_gives_the_numbers_of_metrics(run, capture, result):
    prepared, refined = scores_of(result, capture)
    assert refined.normals.mae_deg != prepared.normals.mae_deg
    ran = run("eval", result, "--truth", capture, "--json")
    assert json.loads(ran.out) == {
        "result": str(result),
        "prepared": asdict(prepared),
        "refined": asdict(refined),
    }


def test_eval_table(run, capture, result):
    lines = run("eval", result, "--truth", capture).out.splitlines()
    assert lines[1].split() == [
        "RMSE",
        "median",
        "95",
        "%",
        "mean",
        "median",
        "95",
        "%",
        "coverage",
    ]
    for line, scores in zip(lines[2:], scores_of(result, capture), strict=True):
        numbers = [float(word) for word in re.findall(r"-?\d+\.\d+", line)]
        depth, normals = scores.depth, scores.normals
        expected = [depth.rmse_mm, depth.median_mm, depth.p95_mm]
        expected += [normals.mae_deg, normals.median_deg, normals.p95_deg]
        np.testing.assert_allclose(numbers[:6], expected, rtol=0, atol=0.0051)
        assert numbers[6] == pytest.approx(100 * depth.coverage, abs=0.051)
    assert [line.split()[0] for line in lines[2:]] == ["prepared", "refined"]


def test_eval_maps(run, refused, capture, result, tmp_path):
    maps = tmp_path / "maps"
    command = ("eval", result, "--truth", capture, "--maps", maps)
    assert run(*command).out.endswith(f"error maps: {maps}\n")
    pictures = ["depth_error.png", "normal_error.png"]
    assert sorted(path.name for path in maps.iterdir()) == [*pictures, "rakelight-files.json"]
    mask = load_capture(capture).mask
    for path in maps.glob("*.png"):
        picture = decode_image(path.read_bytes())
        assert picture.shape[:2] == (36, 48)
        assert len(np.unique(picture[mask].reshape(mask.sum(), -1), axis=0)) > 10
        assert len(np.unique(picture[~mask].reshape((~mask).sum(), -1), axis=0)) == 1
    refused(*command, about=maps, words=("the folder exists", "--overwrite"))
    assert run(*command, "--overwrite").code == 0
    below = maps / "depth_error.png" / "maps"
    refused(
        *command[:-1], below, about=below, words=("Not a directory", "Fix: choose another place")
    )


def test_eval_refuses_what_does_not_belong_together(run, refused, capture, result, tmp_path):
    refused("eval", capture, "--truth", capture, about=capture, words=("not a result folder",))
    refused("eval", result, "--truth", result, about=result, words=("has no truth",))
    assert run("synth", tmp_path / "other", "--size", "0.2", "--lights", "3").code == 0
    before = contents(tmp_path)
    ran = run("eval", result, "--truth", tmp_path / "other")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("error: ")
    assert ran.err.count("\n") == 1
    assert "made from another capture" in ran.err
    assert "(36, 48)" in ran.err
    assert "(72, 96)" in ran.err
    assert contents(tmp_path) == before


def test_eval_refuses_the_truth_of_another_capture_of_the_same_size(
    run, refused, pristine, capture, result, tmp_path
):
    other = tmp_path / "other"
    shutil.copytree(capture, other)
    shutil.rmtree(other / "rgb")  # the photographs are not read
    assert run("eval", result, "--truth", other, "--quiet").code == 0
    one = next((other / "depth").iterdir())
    values = decode_image(one.read_bytes())
    one.write_bytes(encode_png(values + np.uint16(1)))
    words = ("made from another capture", f"seen the depth maps of {pristine}", f"of {other}")
    refused("eval", result, "--truth", other, about=result, words=words)
    stored = json.loads((result / "result.json").read_text())
    del stored["capture"]["depth_checksum"]  # as of an earlier version
    (result / "result.json").write_text(json.dumps(stored))
    assert run("eval", result, "--truth", other, "--quiet").code == 0


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("result.json", "not a result.json"),
        ("depth.tiff", "the file is empty"),
        ("normals.tiff", "the file is empty"),
    ],
)
def test_eval_of_a_damaged_result(run, capture, result, file, words):
    (result / file).write_bytes(b"")
    ran = run("eval", result, "--truth", capture)
    assert (ran.code, ran.out, ran.err.count("\n")) == (2, "", 1)
    assert ran.err.startswith(f"error: {result}/{file}: {words}")


# --- demo ---


@pytest.fixture
def small_demo(monkeypatch):
    monkeypatch.setattr("rakelight.synthetic.demo_scene", small_scene)


@pytest.mark.usefixtures("small_demo")
def test_demo(run, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = run("demo")
    assert ran.code == 0
    assert_reads_back(Path("out/demo/capture"), *small_scene())
    prepared, refined = scores_of(Path("out/demo/result"), Path("out/demo/capture"))
    lines = ran.out.splitlines()
    assert [line.split()[:2] for line in lines[2:4]] == [
        ["prepared", f"{prepared.depth.rmse_mm:.2f}"],
        ["refined", f"{refined.depth.rmse_mm:.2f}"],
    ]
    factor = prepared.normals.mae_deg / refined.normals.mae_deg
    assert lines[4] == f"normals: {factor:.1f} times better"
    for line in lines[5:]:
        assert Path(line.strip()).is_file()
    assert len(lines) > 6

    # Another replaces it, but nothing else.
    mine = tmp_path / "out" / "demo"
    before = [(mine / name).stat().st_ino for name in ("capture", "result")]
    assert run("demo", "-o", mine, "--quiet").code == 0
    assert sorted(path.name for path in mine.iterdir()) == ["capture", "result"]
    assert before != [(mine / name).stat().st_ino for name in ("capture", "result")]
    (mine / "capture" / "rakelight-files.json").unlink()  # now it is like somebody's real capture
    refused("demo", "-o", mine, about=mine / "capture", words=("not overwritten",))
    for name in ("capture", "result"):
        refused("demo", "-o", mine / name, about=mine / name, words=("no demo is written",))


# --- view ---


@pytest.fixture
def opened(monkeypatch):
    """The addresses that the browser was asked to open."""
    addresses = []
    monkeypatch.setattr("webbrowser.open", lambda address: addresses.append(address) or True)
    return addresses


def test_view_opens_the_report(run, capture, tmp_path, opened):
    out = tmp_path / "with space"
    assert run("refine", capture, "-o", out, "--quiet", *QUICK).code == 0
    assert run("view", out).code == 0
    assert opened == [(out / "report.html").as_uri()]
    ran = run("view", out, "--print")
    assert (ran.code, ran.out.strip(), len(opened)) == (0, opened[0], 1)


def test_view_without_a_browser_says_where_the_report_is(run, tmp_path, monkeypatch):
    (tmp_path / "report.html").touch()
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    ran = run("view", tmp_path)
    assert (ran.code, ran.out) == (3, "")
    assert (tmp_path / "report.html").as_uri() in ran.err


def test_view_of_a_batch_opens_its_page(run, refused, tmp_path):
    (tmp_path / "index.html").write_text("x")
    refused("view", tmp_path, about=tmp_path, words=("no report here",))
    (tmp_path / "batch.json").write_text("{}")
    assert run("view", tmp_path, "--print").out == f"{(tmp_path / 'index.html').as_uri()}\n"


def test_view_of_something_else(refused, tmp_path):
    refused("view", tmp_path, about=tmp_path, words=("no report here",))


def test_the_report_of_a_synthetic_capture_shows_its_errors(run, capture, tmp_path):
    for scale, expected in (("auto", True), ("1", False)):  # the truth has the photographs' size
        out = tmp_path / scale
        assert run("refine", capture, "-o", out, "--scale", scale, *QUICK).code == 0
        assert ("Against the truth" in (out / "report.html").read_text()) == expected
