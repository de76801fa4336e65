"""Lights that are given: in Python, in capture.toml, in a .lp file."""

import numpy as np
import pytest

from rakelight import Camera, Capture, GivenLights, load_capture, refine, write_capture
from rakelight.capture.lights import checked_lights, matched, parse_lp
from rakelight.errors import CaptureError, InputError, MethodError
from tests.capture.capture_builder import build, small_capture

DIRECTIONS = np.array([[0.0, 0.0, -1.0], [0.6, 0, -0.8], [0, 0.6, -0.8], [-0.48, -0.36, -0.8]])
LP = "4\n003.png -0.48 0.36 0.8\n000.png 0 0 1\n001.png 0.6 0 0.8\n002.png 0 -0.6 0.8\n"


def with_lights(folder, text, **files):
    build(folder)
    with (folder / "capture.toml").open("a") as file:
        file.write(text)
    for name, content in files.items():
        (folder / name.replace("_lp", ".lp").replace("_txt", ".txt")).write_text(content)
    return folder


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("names", LP),
        ("paths, endings, case", LP.replace("00", "C:\\My Dome\\00").replace(".png", ".JPG")),
        ("decimal commas", LP.replace(" 0.", " 0,").replace("-0.", "-0,")),
        ("other lights too", LP.replace("4\n", "5\nother.png 1 0 0\n")),
        ("order", "4\na 0 0 1\nb 0.6 0 0.8\nc 0 -0.6 0.8\nd -0.48 0.36 0.8\n"),
        ("lengths", LP.replace("0 0 1", "0 0 7")),
    ],
)
def test_lights_lp_is_read_by_itself_in_its_frame(tmp_path, name, text):
    capture = load_capture(with_lights(tmp_path / "c", "", lights_lp=text))
    lights = capture.lights
    assert ("lights-by-order" in [f.code for f in capture.findings]) == (name == "order")
    assert not lights.fixed
    assert lights.directions == pytest.approx(DIRECTIONS)
    chosen = load_capture(tmp_path / "c", photographs=[2, 0]).lights
    assert chosen.directions == pytest.approx(DIRECTIONS[[2, 0]])


def test_a_named_list_that_counts_by_its_order_is_warned_of(tmp_path):
    text = LP.replace("00", "IMG_")
    table = '[lights]\nfile = "dome.lp"\n'
    findings = load_capture(with_lights(tmp_path / "c", table, dome_lp=text)).findings
    (warning,) = [f for f in findings if f.code == "lights-by-order"]
    assert warning.severity == "warning"
    assert "no name in dome.lp" in warning.message


def test_inline_directions_are_in_the_camera_frame_unless_it_says_otherwise(tmp_path):
    rows = DIRECTIONS.tolist()
    text = f"[lights]\ndirections = {rows}\nintensities = [1, 2, 1, 2.5]\nfixed = true\n"
    lights = load_capture(with_lights(tmp_path / "c", text)).lights
    assert lights.fixed
    assert np.array_equal(lights.directions, DIRECTIONS)
    assert lights.intensities.tolist() == [1, 2, 1, 2.5]
    turned = (DIRECTIONS * [1, -1, -1]).tolist()
    other = f'[lights]\ndirections = {turned}\nframe = "opengl"\n'
    lights = load_capture(with_lights(tmp_path / "d", other)).lights
    assert np.array_equal(lights.directions, DIRECTIONS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[lights]\nfixed = true\n", "one of file, directions, positions"),
        ("[lights]\nintensities = [1, 1, 1, 1]\n", "Fix: add one of them, or take the table out"),
        ('[lights]\nfile = "a"\npositions = "b"\n', "Fix: keep one of them"),
        ("[lights]\ndirections = [[0, 0, -1]]\n", "these do not fit the photographs"),
        ("[lights]\ndirections = [[0, 0, -1], [0, -1]]\n", "rows of different length"),
        ('[lights]\nfile = "../lights.lp"\n', "leaves the folder"),
        ('[lights]\nfile = "/etc/passwd"\n', "leaves the folder"),
        ('[lights]\nfile = "no.lp"\n', "no.lp: cannot be read"),
        ('[lights]\nframe = "opencl"\n', "did you mean 'opengl'"),
        ("[lights]\nfixd = true\n", "did you mean 'fixed'"),
        (f"[lights]\ndirections = {[[0, 0, 1]] * 4}\n", "all lights are behind the object"),
        (f"[lights]\ndirections = {[[0, 0, -3]] * 4}\n", "unit vectors"),
        (f"[lights]\npositions = {[[0, 0, 9]] * 4}\n", "all lights are behind the object"),
        (f"[lights]\npositions = {[[0, 0, 9]] * 4}\n", "turn y and z round"),
        (f"[lights]\npositions = {[[300, 0, 9]] * 4}\n", "divide by 1000"),
        (f"[lights]\npositions = {[[0, 0, -1e300]] * 4}\n", "a coordinate of 1e+300 m"),
        (f"[lights]\ndirections = {[[0, 0, -1]] * 4}\nintensities = [1, 1, 1, 0]\n", "above 0"),
    ],
)
def test_wrong_lights_in_capture_toml_are_refused(tmp_path, text, message):
    with pytest.raises(InputError) as error:
        load_capture(with_lights(tmp_path / "c", text))
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "files", "where"),
    [
        ("[lights]\ndirections = [[0, 0, -1]]\n", {}, "capture.toml: key 'lights.directions'"),
        ('[lights]\npositions = "at.txt"\n', {"at_txt": "0 0 0\n"}, "at.txt"),
        (f"[lights]\npositions = {[[0, 0, 9]] * 4}\n", {}, "capture.toml: key 'lights.positions'"),
        ("[lights]\nintensities = [1, 2]\nfile = 'a.lp'\n", {"a_lp": LP},
         "capture.toml: key 'lights.intensities'"),
        ("", {"lights_lp": LP.replace("0.8", "-0.8").replace("0 0 1", "0 0 -1")}, "lights.lp"),
    ],
)  # fmt: skip
def test_errors_about_lights_name_where_these_are_stated(tmp_path, text, files, where):
    with pytest.raises(CaptureError) as error:
        load_capture(with_lights(tmp_path / "c", text, **files))
    assert error.value.source == f"{tmp_path / 'c'}/{where}"
    if "do not fit" in str(error.value):
        assert error.value.needed in (
            "4 rows of 3, one per photograph", "4 numbers, one per photograph",
        )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "first line ''"),
        ("4\n000.png 0 0 1\n", "seen 4, and 1 lines of lights"),
        ("1\n000.png 0 x 1\n", "line 2"),
        ("1\n000.png 0 nan 1\n", "finite"),
        ("1\n0 0 1\n", "name x y z"),
        ("1\n000.png 0 0 1 1.0\n", "name x y z"),
        ("9" * 5000 + "\n", "first line"),
        ("1\n000.png 0 0 0\n", "photographs without a light"),
        (LP.replace("003", "000"), "none for 003.png"),
        (LP.replace("4\n", "5\n0/000.png 0 0 1\n"), "two lights for a photograph"),
    ],
)
def test_wrong_lp_files_are_refused(tmp_path, text, message):
    with pytest.raises(CaptureError) as error:
        load_capture(with_lights(tmp_path / "c", "", lights_lp=text))
    assert message in str(error.value)


@pytest.mark.parametrize("quote", ['"', "'"])
@pytest.mark.parametrize("place", ["", "C:\\My dome\\"])
def test_quoted_names_belong_to_their_photographs(quote, place):
    lines = [f"{quote}{place}{name}.jpg{quote} {i}.0 0 1" for i, name in enumerate("cab")]
    names, vectors = parse_lp("\n".join(["3", *lines]).encode(), "a.lp")
    assert vectors[matched(names, ["a.png", "b.png", "c.png"], "a.lp"), 0].tolist() == [1, 2, 0]


def test_names_with_blanks_and_other_bytes_are_kept():
    names, _ = parse_lp(b"\xef\xbb\xbf2\r\nmy dome \xe9.jpg\t0 0 1\r\nb.jpg 0 0 1\r\n", "a.lp")
    assert names == ["my dome \udce9.jpg", "b.jpg"]


def test_a_list_in_utf_16_is_read():
    text = LP.replace("\n", "\r\n")
    assert parse_lp(text.encode("utf-16"), "a.lp")[0] == parse_lp(LP.encode(), "a.lp")[0]


@pytest.mark.parametrize(
    "lights",
    [
        GivenLights(DIRECTIONS, fixed=True),
        GivenLights(DIRECTIONS, intensities=np.array([[1.0, 2, 3]] * 4)),
        GivenLights(positions_m=0.7 * DIRECTIONS, intensities=np.array([1.0, 1.5, 2, 3])),
    ],
)
def test_written_lights_are_read_back_as_they_were(tmp_path, lights):
    write_capture(small_capture(lights=lights), tmp_path / "c")
    again = load_capture(tmp_path / "c").lights
    assert again.fixed == lights.fixed
    for name in ("directions", "positions_m", "intensities"):
        before, after = getattr(lights, name), getattr(again, name)
        assert (before is None) == (after is None)
        if before is not None:
            assert after == pytest.approx(before, abs=1e-15)


def from_arrays(lights):
    photographs = np.random.default_rng(0).integers(50, 200, (4, 6, 8, 3), np.uint8)
    return Capture.from_arrays(
        photographs, np.full((3, 4), 0.5), Camera(8, 6, 10.0, 10.0, 3.5, 2.5), mask=np.ones((6, 8)),
        lights=lights,
    )  # fmt: skip


def test_from_arrays_takes_lights_and_select_subsets_them():
    capture = from_arrays(GivenLights(1.01 * DIRECTIONS))
    assert capture.lights.directions == pytest.approx(DIRECTIONS)
    assert capture.select([3]).lights.directions == pytest.approx(DIRECTIONS[3:])


@pytest.mark.parametrize(
    "lights",
    [
        GivenLights(),
        GivenLights(DIRECTIONS, DIRECTIONS),
        GivenLights(DIRECTIONS[:3]),
        GivenLights(DIRECTIONS.tolist()),
        GivenLights(np.full((4, 3), np.nan)),
        GivenLights(positions_m=-1e300 * np.ones((4, 3))),
        GivenLights(DIRECTIONS, fixed=1),
        GivenLights(DIRECTIONS, intensities=np.full(4, -1.0)),
        "lights.lp",
    ],
)
def test_wrong_lights_in_python_are_refused(lights):
    with pytest.raises(InputError, match="lights"):
        from_arrays(lights)


def test_methods_without_use_for_lights_say_so():
    capture = from_arrays(GivenLights(DIRECTIONS, fixed=True))
    for method in ("multi-light-alternating", "ldr-ps"):
        with pytest.raises(MethodError, match="keeps no given lights"):
            refine(capture, method)
    codes = [finding.code for finding in refine(capture, "fusion-like").findings]
    assert "given-lights-unused" in codes


@pytest.mark.parametrize(
    ("directions", "seen"),
    [
        (DIRECTIONS.astype(str), r"\(4, 3\) <U"),
        (DIRECTIONS.astype(complex), r"\(4, 3\) complex128"),
        (np.ma.masked_equal(DIRECTIONS, 0), r"masked \(4, 3\) float64"),
        (DIRECTIONS.tolist(), "list"),
    ],
)
def test_what_is_no_array_of_numbers_is_shown(directions, seen):
    needed = r"needed a numpy\.ndarray \(4, 3\) of numbers"
    with pytest.raises(InputError, match=f"seen {seen}.*, {needed}"):
        checked_lights(GivenLights(directions), 4, 0.6)
