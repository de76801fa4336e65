"""Result folders: whole or not at all, result.json, reading back."""

import errno
import hashlib
import json
import os
import re
from dataclasses import replace
from enum import Enum
from pathlib import Path

import msgspec
import numpy as np
import pytest

from rakelight.errors import InputError, MachineError, OutputExistsError
from rakelight.export import load_result, read_summary, write_result
from rakelight.export.lights import lights_json, parse_lights
from rakelight.export.mesh_formats import MESH_FORMATS
from rakelight.export.summary import Conventions
from rakelight.model import Finding, Lights
from rakelight.photometry.images import LightParameters
from rakelight.report import save_result
from tests.full_disk import full_at

FILES = {
    "depth.tiff",
    "prepared_depth.tiff",
    "depth.png",
    "normals.tiff",
    "normals.png",
    "albedo.png",
    "confidence.png",
    "lights.json",
    "preview.png",
    "result.json",
}


def strict_json(path):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def leftovers(parent, *expected):
    return {path.name for path in parent.iterdir()} - set(expected)


@pytest.mark.parametrize("mesh", MESH_FORMATS)
def test_the_folder_holds_what_result_json_lists(sphere, tmp_path, mesh):
    more = {f"mesh.{mesh}"}
    write_result(sphere, tmp_path / "out", mesh=mesh)
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES | more
    assert set(strict_json(tmp_path / "out" / "result.json")["files"]) == FILES | more
    assert leftovers(tmp_path, "out") == set()


def test_result_json_says_the_frame_of_every_mesh_format():
    fields = {field.name for field in msgspec.structs.fields(Conventions)}
    assert {name for name in fields if re.fullmatch(r"mesh_\w+_frame", name)} == {
        f"mesh_{name}_frame" for name in MESH_FORMATS
    }


def test_result_save_is_save_result_with_a_report(sphere, tmp_path):
    save_result(sphere, str(tmp_path / "a" / "b"), mesh="none", normal_map="directx")
    assert content(tmp_path / "a" / "b").keys() == FILES | {"report.html"}
    conventions = strict_json(tmp_path / "a" / "b" / "result.json")["conventions"]
    assert conventions["normal_map"] == "directx"


def test_extra_files_arrive_with_the_rest_and_are_listed(sphere, tmp_path):
    write_result(
        sphere,
        tmp_path / "out",
        mesh="none",
        extra_files={"report.html": lambda r: r.source.encode()},
    )
    assert (tmp_path / "out" / "report.html").read_bytes() == sphere.source.encode()
    assert "report.html" in strict_json(tmp_path / "out" / "result.json")["files"]


@pytest.mark.parametrize(
    "name", ["../a.txt", "/tmp/a.txt", "a/a.txt", "a\\a.txt", "..", "", "report.html",
             "depth.tiff", "result.json", "a\0b", "caf\udce9.txt", 3],
)  # fmt: skip
def test_extra_files_neither_leave_the_folder_nor_replace_its_own(sphere, tmp_path, name):
    with pytest.raises(InputError, match=r"of a file in the result folder|a file of that name"):
        save_result(sphere, tmp_path / "out", mesh="none", extra_files={name: b"mine"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("extra", [["a.txt"], {"a.txt": "text"}])
def test_extra_files_are_names_and_bytes(sphere, tmp_path, extra):
    with pytest.raises(InputError, match="extra_files"):
        save_result(sphere, tmp_path / "out", mesh="none", extra_files=extra)


def test_result_json_says_everything(sphere, tmp_path):
    write_result(sphere, tmp_path / "out")
    summary = strict_json(tmp_path / "out" / "result.json")
    assert summary["schema"] == "rakelight-result/1"
    assert summary["method"] == "multi-light"
    assert summary["options"] == {"scale": 2, "robust": True}
    assert summary["photographs"] == ["000.png", "001.png"]
    assert summary["source"] == "captures/sphere"
    assert summary["camera"] == {
        "width": 64, "height": 48, "fx": 300.0, "fy": 280.0, "cx": 29.0, "cy": 26.5
    }  # fmt: skip
    assert summary["pixels"] == int(sphere.mask.sum())
    assert (summary["iterations"], summary["converged"]) == (3, True)
    assert summary["energy"] == [9.0, 4.0, 3.5]
    assert summary["timings_s"] == {"prepare": 0.5, "solve": 1.25}
    assert summary["findings"] == [
        {
            "severity": "note",
            "code": "mask-full",
            "message": "the mask is full",
            "remedy": "give a mask",
        }
    ]
    assert summary["units"]["length"] == "metre"
    assert summary["conventions"]["depth_png_values_per_metre"] == 100_000.0
    assert summary["conventions"]["normal_map"] == "opengl"
    assert summary["conventions"]["albedo_encoding"] == "srgb"


def test_result_json_says_what_every_other_file_holds(sphere, tmp_path):
    write_result(sphere, tmp_path / "out")
    written = strict_json(tmp_path / "out" / "result.json")["checksums"]
    assert written == {
        name: hashlib.sha256(data).hexdigest()
        for name, data in content(tmp_path / "out").items()
        if name != "result.json"
    }


def test_every_key_of_result_json_is_documented(sphere, tmp_path):
    write_result(sphere, tmp_path / "out")
    summary = strict_json(tmp_path / "out" / "result.json")
    page = Path(__file__).parents[2] / "docs" / "reference" / "files.md"
    words = page.read_text(encoding="utf-8")
    keys = [*summary, *summary["conventions"], *summary["units"], *summary["files"]]
    assert [key for key in keys if f"`{key}`" not in words] == []


def test_options_of_any_type_are_written_as_json(sphere, tmp_path):
    class Size(Enum):
        LARGE = "large"

    options = {
        "count": np.int64(4),
        "gain": np.float32(0.5),
        "on": np.bool_(True),
        "nothing": None,
        "vector": np.array([1.0, np.inf]),
        "nan": float("nan"),
        "size": Size.LARGE,
        "path": Path("a/b"),
        "nested": {"finding": Finding("note", "a", "b"), 3: (1, 2)},
    }
    write_result(replace(sphere, options=options), tmp_path / "out", mesh="none")
    assert load_result(tmp_path / "out").options == {
        "count": 4,
        "gain": 0.5,
        "on": True,
        "nothing": None,
        "vector": [1.0, None],
        "nan": None,
        "size": "large",
        "path": str(Path("a/b")),
        "nested": {
            "finding": {"severity": "note", "code": "a", "message": "b", "remedy": ""},
            "3": [1, 2],
        },
    }


def test_a_direction_that_is_none_is_refused():
    lights = Lights(np.array([[[0.0, 0.0, -2.0]]]), np.array([[0.1]]))
    data = lights_json(lights).replace(b"-1.0", b"-1e308")
    with pytest.raises(InputError, match=r"a direction is no unit vector.*1e\+308"):
        parse_lights(data, source="lights.json")


def test_lights_json(sphere, tmp_path):
    write_result(sphere, tmp_path / "white", mesh="none")
    first, second = strict_json(tmp_path / "white" / "lights.json")["photographs"]
    assert first["name"] == "000.png"
    assert first["position_m"] is None
    white = second["channels"]["white"]
    assert white["direction"] == pytest.approx([0.6, 0.0, -0.8])
    assert (white["intensity"], white["ambient"]) == (pytest.approx(2.0), 0.2)

    lights = Lights(
        vector=np.array([[[0, 0, -1.0], [0, 0, -2.0], [0, 0, -3.0]]]),
        ambient=np.zeros((1, 3)),
        position_m=np.array([[[0.1, 0.2, 0.3], [0.1, 0.2, 0.4], [0.1, 0.2, 0.5]]]),
        middle_m=np.array([0.0, 0.0, 0.9]),
    )
    near = replace(sphere, lights=lights, photograph_names=())
    write_result(near, tmp_path / "leds", mesh="none")
    written = strict_json(tmp_path / "leds" / "lights.json")
    (only,) = written["photographs"]
    assert written["middle_m"] == [0, 0, 0.9]
    assert only["name"] is None
    assert only["position_m"] == pytest.approx([0.1, 0.2, 0.4])
    assert only["channels"]["blue"]["position_m"] == [0.1, 0.2, 0.5]
    assert [only["channels"][c]["intensity"] for c in ("red", "green", "blue")] == [1, 2, 3]


def test_a_distant_lamp_among_near_ones_has_no_position(sphere, tmp_path):
    lights = LightParameters(sphere.lights.vector, sphere.lights.ambient, np.array([[2.0], [0.0]]))
    near = replace(sphere, lights=lights.as_lights(np.array([0.0, 0.0, 0.9])))
    write_result(near, tmp_path / "out", mesh="none")
    first, second = strict_json(tmp_path / "out" / "lights.json")["photographs"]
    assert first["position_m"] == pytest.approx(
        np.array([0, 0, 0.9]) + 0.5 * near.lights.direction[0, 0]
    )
    assert second["position_m"] is second["channels"]["white"]["position_m"] is None


def test_load_result_gives_back_what_was_saved(sphere, tmp_path):
    write_result(sphere, tmp_path / "out")
    loaded = load_result(tmp_path / "out")
    np.testing.assert_array_equal(loaded.depth, sphere.depth)
    np.testing.assert_array_equal(loaded.normals, sphere.normals)
    np.testing.assert_allclose(loaded.confidence, sphere.confidence, atol=0.5 / 255 + 1e-6)
    assert loaded.camera == sphere.camera
    assert loaded.findings == sphere.findings


def test_expected_errors_are_written_and_read_where_there_are_any(sphere, tmp_path):
    loaded = save_and_load(sphere, tmp_path / "without")
    assert loaded.depth_sigma is loaded.normal_sigma is None
    depth_sigma = np.where(sphere.mask, 0.002, np.nan).astype(np.float32)
    normal_sigma = 1000 * depth_sigma
    normal_sigma[np.nonzero(sphere.mask)[0][0], np.nonzero(sphere.mask)[1][0]] = np.inf
    told = replace(sphere, depth_sigma=depth_sigma, normal_sigma=normal_sigma)
    loaded = save_and_load(told, tmp_path / "with")
    np.testing.assert_array_equal(loaded.depth_sigma, depth_sigma)
    normal_sigma[np.isinf(normal_sigma)] = np.nan  # not known
    np.testing.assert_array_equal(loaded.normal_sigma, normal_sigma)
    assert {"depth_sigma.tiff", "normal_sigma.tiff"} < set(read_summary(tmp_path / "with").files)


def test_expected_errors_of_another_size_are_refused(sphere, tmp_path):
    wrong = replace(sphere, depth_sigma=np.ones((3, 3), np.float32))
    with pytest.raises(InputError, match="another size") as error:
        write_result(wrong, tmp_path / "out")
    assert error.value.source == "depth_sigma"


def save_and_load(result, folder):
    write_result(result, folder, mesh="none")
    return load_result(folder)


@pytest.mark.parametrize("made", ["nothing", "file", "empty folder"])
def test_load_result_refuses_what_is_no_result(tmp_path, made):
    target = tmp_path / "x"
    if made == "file":
        target.write_bytes(b"")
    elif made == "empty folder":
        target.mkdir()
    with pytest.raises(InputError, match="not a result folder"):
        load_result(target)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a result.json"),
        (b"[1, 2]", "not a result.json"),
        (b"\xff\xfe", "not a result.json"),
        (b'{"schema": "rakelight-result/1"}', "not a result.json"),
        (b'{"schema": "rakelight-result/9"}', "another version"),
    ],
)
def test_load_result_refuses_a_damaged_result_json(sphere, tmp_path, data, message):
    write_result(sphere, tmp_path / "out", mesh="none")
    (tmp_path / "out" / "result.json").write_bytes(data)
    with pytest.raises(InputError, match=message):
        load_result(tmp_path / "out")


def test_load_result_refuses_missing_damaged_and_foreign_files(sphere, tmp_path):
    write_result(sphere, tmp_path / "out", mesh="none")
    depth = tmp_path / "out" / "depth.tiff"
    whole = depth.read_bytes()
    depth.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"depth\.tiff|damaged|decode"):
        load_result(tmp_path / "out")
    depth.write_bytes((tmp_path / "out" / "normals.tiff").read_bytes())
    with pytest.raises(InputError, match="does not belong"):
        load_result(tmp_path / "out")
    depth.unlink()
    with pytest.raises(InputError):
        load_result(tmp_path / "out")


# ---- nothing that is not finite ----


@pytest.mark.parametrize("name", ["vector", "ambient", "ambient_direction"])
def test_lights_that_are_not_finite_are_said(sphere, tmp_path, name):
    lights = replace(sphere.lights, ambient_direction=np.array([0.1, 0.2, -0.3]))
    broken = getattr(lights, name).copy()
    broken[..., -1] = np.nan
    write_result(replace(sphere, lights=replace(lights, **{name: broken})), tmp_path / "out")
    summary = strict_json(tmp_path / "out" / "result.json")
    assert summary["converged"] is False
    assert "not-finite" in {each["code"] for each in summary["findings"]}


def test_pixels_that_are_not_finite_leave_the_object(sphere, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    rows, columns = np.nonzero(sphere.mask)
    picked = [(int(rows[k]), int(columns[k])) for k in (200, 400, 600, 700, 800, 900)]
    depth, normals = sphere.depth.copy(), sphere.normals.copy()
    albedo, confidence = sphere.albedo.copy(), sphere.confidence.copy()
    depth[picked[0]], depth[picked[1]], depth[picked[2]] = np.inf, -1.0, 0.0
    normals[picked[3]] = np.nan
    albedo[picked[4]], confidence[picked[5]] = np.inf, np.nan
    bad = replace(
        sphere,
        depth=depth,
        normals=normals,
        albedo=albedo,
        confidence=confidence,
        energy=(1.0, float("nan")),
        timings_s={"solve": float("inf")},
    )
    write_result(bad, tmp_path / "out")
    written = tifffile.imread(tmp_path / "out" / "depth.tiff")
    prepared = tifffile.imread(tmp_path / "out" / "prepared_depth.tiff")
    assert all(np.isnan(prepared[p]) for p in picked[:4])
    assert np.isfinite(prepared[written > 0]).all()
    normals_written = tifffile.imread(tmp_path / "out" / "normals.tiff")
    assert not np.isinf(written).any()
    assert (np.isnan(normals_written).any(axis=-1) == np.isnan(written)).all()
    assert [bool(np.isnan(written[p])) for p in picked] == [True] * 4 + [False] * 2
    summary = strict_json(tmp_path / "out" / "result.json")
    assert summary["energy"] == [1.0, None]
    assert summary["timings_s"] == {"solve": None}
    assert summary["converged"] is False
    (finding,) = [f for f in summary["findings"] if f["code"] == "not-finite"]
    assert finding["severity"] == "warning"
    assert "6 pixels" in finding["message"]
    assert load_result(tmp_path / "out").energy == pytest.approx((1.0, np.nan), nan_ok=True)


def test_lights_that_are_not_finite_become_null(sphere, tmp_path):
    lights = replace(sphere.lights, vector=np.full((2, 1, 3), np.nan))
    write_result(replace(sphere, lights=lights), tmp_path / "out", mesh="none")
    first = strict_json(tmp_path / "out" / "lights.json")["photographs"][0]
    assert first["channels"]["white"]["direction"] == [None, None, None]
    summary = strict_json(tmp_path / "out" / "result.json")
    assert summary["converged"] is False
    assert "the lights" in summary["findings"][-1]["message"]


def test_a_result_without_any_finite_depth_is_refused(sphere, tmp_path):
    empty = replace(sphere, depth=np.full_like(sphere.depth, np.nan))
    with pytest.raises(InputError, match="no pixel"):
        write_result(empty, tmp_path / "out")
    assert leftovers(tmp_path) == set()


def test_a_result_of_single_pixels_has_no_mesh_and_says_so(sphere, tmp_path):
    alone = np.full_like(sphere.depth, np.nan)
    alone[20, 30] = alone[25, 35] = 0.6
    for mesh in MESH_FORMATS:
        write_result(replace(sphere, depth=alone), tmp_path / mesh, mesh=mesh)
        assert content(tmp_path / mesh).keys() == FILES
        summary = strict_json(tmp_path / mesh / "result.json")
        assert [f["code"] for f in summary["findings"]] == ["mask-full", "no-mesh"]


def test_a_result_that_was_cut_has_nothing_outside(sphere, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    depth = sphere.depth.copy()
    depth[:, 30:] = np.nan
    assert np.isfinite(sphere.prepared_depth[:, 30:]).any()
    write_result(replace(sphere, depth=depth), tmp_path / "out")
    outside = np.isnan(tifffile.imread(tmp_path / "out" / "depth.tiff"))
    assert np.isnan(tifffile.imread(tmp_path / "out" / "prepared_depth.tiff")[outside]).all()


def test_arrays_of_another_size_are_refused(sphere, tmp_path):
    for name in ("depth", "normals", "albedo", "confidence", "prepared_depth"):
        wrong = replace(sphere, **{name: getattr(sphere, name)[:-1]})
        with pytest.raises(InputError, match="another size") as caught:
            write_result(wrong, tmp_path / "out")
        assert caught.value.source == name


@pytest.mark.parametrize("depth", [[[1.0]], np.ones((3, 3), complex)])
def test_what_is_no_array_of_numbers_is_refused(sphere, tmp_path, depth):
    with pytest.raises(InputError, match="depth is no array of numbers"):
        write_result(replace(sphere, depth=depth), tmp_path / "out")


def test_nothing_that_is_written_is_infinite(sphere, tmp_path):
    inside = np.argwhere(sphere.mask)
    row, column = inside[len(inside) // 2]
    before = sphere.prepared_depth.copy()
    before[row, column] = np.inf
    write_result(replace(sphere, prepared_depth=before), tmp_path / "out", mesh="none")
    again = load_result(tmp_path / "out")
    assert np.isnan(again.prepared_depth[row, column])
    np.testing.assert_array_equal(again.mask, sphere.mask)


def test_names_of_other_photographs_are_refused(sphere, tmp_path):
    """They could be saved, and not be loaded again."""
    with pytest.raises(InputError, match=r"photograph_names: not a name for each light .*1 names"):
        write_result(replace(sphere, photograph_names=("a.png",)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_unknown_options_are_refused(sphere, tmp_path):
    with pytest.raises(InputError, match="no such option"):
        write_result(sphere, tmp_path / "out", mesh="obj")
    with pytest.raises(InputError, match="no such option"):
        write_result(sphere, tmp_path / "out", normal_map="vulkan")
    assert leftovers(tmp_path) == set()


# ---- fault 24: something stands there ----


def test_an_older_result_stays_without_overwrite_and_goes_with_it(sphere, tmp_path):
    out = tmp_path / "out"
    write_result(sphere, out)
    before = content(out)
    with pytest.raises(OutputExistsError):
        write_result(replace(sphere, method="other"), out)
    assert content(out) == before
    write_result(replace(sphere, method="other"), out, overwrite=True, mesh="none")
    assert content(out).keys() == FILES
    assert load_result(out).method == "other"
    assert leftovers(tmp_path, "out") == set()


@pytest.mark.parametrize("made", ["file", "folder of somebody", "capture"])
def test_what_is_no_result_is_never_replaced(sphere, tmp_path, made):
    out = tmp_path / "out"
    if made == "file":
        out.write_text("mine")
    else:
        out.mkdir()
        name = "capture.toml" if made == "capture" else "thesis.txt"
        (out / name).write_text("mine")
    with pytest.raises(OutputExistsError):
        write_result(sphere, out, overwrite=True)
    mine = out if made == "file" else next(out.iterdir())
    assert mine.read_text() == "mine"
    assert leftovers(tmp_path, "out") == set()


# ---- fault 25: disk full, read-only ----


@pytest.mark.parametrize("failing", ["depth.tiff", "mesh.ply", "result.json"])
@pytest.mark.parametrize("older", [False, True])
def test_a_full_disk_leaves_no_stump_and_the_older_result(
    sphere, tmp_path, monkeypatch, failing, older
):
    out = tmp_path / "out"
    if older:
        write_result(sphere, out)
    before = content(out) if older else None
    full_at(monkeypatch, lambda path: path.name == failing)
    with pytest.raises(MachineError, match="cannot be written") as caught:
        write_result(replace(sphere, method="other"), out, overwrite=True)
    assert caught.value.exit_code == 3
    assert "No space left" in caught.value.seen
    assert "bytes" in caught.value.needed
    if older:
        assert content(out) == before
        assert leftovers(tmp_path, "out") == set()
    else:
        assert leftovers(tmp_path) == set()


def test_an_interrupt_leaves_no_stump(sphere, tmp_path, monkeypatch):
    opened = Path.open

    def interrupt(path, mode="r", *rest, **named):
        if "w" not in mode:
            return opened(path, mode, *rest, **named)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "open", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_result(sphere, tmp_path / "out")
    assert leftovers(tmp_path) == set()


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES])
def test_a_place_that_may_not_be_written_to(sphere, tmp_path, monkeypatch, code):
    def refuse(path, *args, **kwargs):
        raise OSError(code, os.strerror(code), str(path))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(MachineError) as caught:
        write_result(sphere, tmp_path / "out")
    assert str(tmp_path / "out") in str(caught.value)
    assert leftovers(tmp_path) == set()


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
def test_a_folder_without_write_permission(sphere, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    with pytest.raises(MachineError):
        write_result(sphere, locked / "out")


# ---- faults 23 and 29: names ----


@pytest.mark.parametrize(
    "name",
    ["with space", 'say "hi"', "it's", "Müllers Käse", "two\nlines", "-o", "<script>", "=cmd"],
)
def test_folders_of_any_name(sphere, tmp_path, name):
    write_result(sphere, tmp_path / name)
    assert read_summary(tmp_path / name).pixels == int(sphere.mask.sum())


@pytest.mark.skipif(os.name != "posix", reason="file names are bytes on POSIX only")
def test_names_that_are_not_utf8(sphere, tmp_path):
    name = os.fsdecode(b"caf\xe9")
    try:
        (tmp_path / name).mkdir()
        (tmp_path / name).rmdir()
    except OSError:
        pytest.skip("this file system takes UTF-8 names only")
    named = replace(
        sphere,
        source=name,
        photograph_names=(name + ".png", 'a\n"b"\x1b.png'),
        findings=(Finding("warning", "x", f"about {name}"),),
    )
    write_result(named, tmp_path / name)
    summary = strict_json(tmp_path / name / "result.json")
    assert summary["source"] == "caf\\xe9"
    assert summary["photographs"] == ["caf\\xe9.png", 'a\n"b"\x1b.png']
    assert summary["findings"][0]["message"] == "about caf\\xe9"
    lights = strict_json(tmp_path / name / "lights.json")
    assert lights["photographs"][0]["name"] == "caf\\xe9.png"
    assert load_result(tmp_path / name).source == "caf\\xe9"
