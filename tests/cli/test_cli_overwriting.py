"""faults.md 33: a folder is never emptied that rakelight did not fill, whatever lies in it."""

import errno
import json
import os
import shutil
from pathlib import Path

import pytest

from rakelight import folders
from rakelight.export import load_result
from tests.cli.cli_helpers import QUICK, contents


def command_into(command, tmp_path):
    """The arguments of a command that may replace an older folder at tmp_path/out."""
    capture, out = tmp_path / "capture", tmp_path / "out"
    return {
        "refine": ("refine", capture, "-o", out, "--overwrite", *QUICK),
        "eval": ("eval", tmp_path / "result", "--truth", capture, "--maps", out, "--overwrite"),
        "synth": ("synth", out, "--size", "0.1", "--lights", "3", "--overwrite"),
        "paper": ("paper", "figure2", "--size", "0.1", "-o", out, "--overwrite"),
        "demo capture": ("demo", "-o", tmp_path),
        "demo result": ("demo", "-o", tmp_path),
    }[command]


# What an older version took for its own folder, whatever the file held and whatever lay beside it.
MARKERS = {
    "refine": "result.json",
    "eval": "depth_error.png",
    "synth": "truth/depth.tiff",
    "paper": "figure2.json",
    "demo capture": "truth/depth.tiff",
    "demo result": "result.json",
}


@pytest.mark.usefixtures("capture", "result")
@pytest.mark.parametrize(
    "content", [b"", b"{}", b'{"schema": "rakelight-result/1", "x": ' + b"[" * 5000]
)
@pytest.mark.parametrize("command", MARKERS)
def test_33_a_file_of_a_known_name_makes_no_folder_ours(refused, tmp_path, command, content):
    arguments = command_into(command, tmp_path)
    out = tmp_path / (command.split()[1] if "demo" in command else "out")
    shutil.rmtree(out, ignore_errors=True)
    marker = out / MARKERS[command]
    marker.parent.mkdir(parents=True)
    marker.write_bytes(content)
    (out / "thesis.docx").write_text("x")
    refused(*arguments, about=out, words=("not written by rakelight", "not overwritten", "Fix: "))


@pytest.mark.parametrize("command", ["refine", "eval", "synth", "paper"])
@pytest.mark.usefixtures("capture", "result")
def test_33_the_thesis_beside_true_files_survives(run, refused, tmp_path, command):
    arguments, out = command_into(command, tmp_path), tmp_path / "out"
    assert run(*arguments).code == 0
    assert run(*arguments).code == 0
    (out / "thesis.docx").write_text("x")
    words = ("not overwritten", "(seen thesis.docx, needed a ", "Fix: move your files away")
    refused(*arguments, about=out, words=words)
    # The true list alone, copied beside it.
    manifest = out / ("result.json" if command == "refine" else "rakelight-files.json")
    (tmp_path / "p").mkdir()
    shutil.copy(manifest, tmp_path / "p")
    (out / "thesis.docx").rename(tmp_path / "p" / "thesis.docx")
    shutil.rmtree(out)
    (tmp_path / "p").rename(out)
    refused(*arguments, about=out, words=words)
    (out / "thesis.docx").unlink()
    assert run(*arguments).code == 0


def no_home():
    raise RuntimeError("no home")


def test_a_user_without_a_home_may_overwrite(run, result, capture, tmp_path, monkeypatch):
    """As in a container under a number that has no name."""
    monkeypatch.setattr("pathlib.Path.home", no_home)
    maps = ("eval", result, "--truth", capture, "--maps", tmp_path / "maps")
    assert run(*maps).code == 0
    assert run(*maps, "--overwrite").code == 0


def test_33_the_demo_keeps_the_thesis(refused, run, capture, result, tmp_path):
    shutil.rmtree(capture)  # out of the way of demo's own
    assert run("synth", capture, "--size", "0.1", "--lights", "3").code == 0
    (result / "thesis.docx").write_text("x")
    refused("demo", "-o", tmp_path, about=result, words=("seen thesis.docx",))
    (result / "thesis.docx").rename(capture / "rgb" / "thesis.docx")
    refused("demo", "-o", tmp_path, about=capture, words=("seen rgb/thesis.docx",))


def as_a_template(capture):
    """A person's own photograph, under the name that synth gives."""
    (capture / "rgb" / "000.png").write_bytes(b"the only copy")
    return "rgb/000.png"


def made_by_hand(capture):
    """A capture with all that synth writes, but its list."""
    (capture / "rakelight-files.json").unlink()
    return "capture.toml"


def without_truth(capture):
    """What write_capture makes of real photographs."""
    from rakelight.capture import load_capture, write_capture

    loaded = load_capture(capture)
    shutil.rmtree(capture)
    write_capture(loaded, capture)
    return "capture.toml"


@pytest.mark.parametrize("change", [as_a_template, made_by_hand, without_truth])
def test_33_synth_never_replaces_a_real_capture(refused, capture, tmp_path, change):
    words = (f"seen {change(capture)}, needed a synthetic capture",)
    refused("synth", capture, "--size", "0.1", "--overwrite", about=capture, words=words)
    refused("demo", "-o", tmp_path, about=capture, words=words)


def test_33_an_older_result_is_known_by_its_result_json(run, capture, result):
    summary = json.loads((result / "result.json").read_text())
    assert summary["schema"] == "rakelight-result/1"
    assert not (result / "rakelight-files.json").exists()
    assert run("refine", capture, "-o", result, "--overwrite", "--mesh", "glb", *QUICK).code == 0
    assert not (result / "mesh.ply").exists()


def test_33_a_result_is_not_replaced_by_another_kind_of_folder(refused, capture, result):
    refused("synth", result, "--overwrite", about=result, words=("seen albedo.png",))
    command = ("refine", capture, "-o")
    other = shutil.copytree(capture, capture.with_name("other"))
    refused(*command, other, "--overwrite", about=other, words=("seen capture.toml",))


# --- error maps and others never go into what they are made from ---


@pytest.mark.parametrize("place", ["capture", "capture/maps", "capture/truth", "link/new/one"])
def test_24_maps_are_never_written_into_the_capture(refused, capture, result, tmp_path, place):
    (tmp_path / "link").symlink_to(capture)
    command = ("eval", result, "--truth", capture, "--overwrite", "--maps")
    words = ("into the capture, which is never changed", "Fix: choose a folder beside it")
    refused(*command, tmp_path / place, about=tmp_path / place, words=words)


@pytest.mark.parametrize("place", ["result", "result/maps"])
def test_24_maps_are_never_written_into_the_result(refused, capture, result, tmp_path, place):
    command = ("eval", result, "--truth", capture, "--overwrite", "--maps")
    words = ("into the result, which is never changed", "Fix: choose a folder beside it")
    refused(*command, tmp_path / place, about=tmp_path / place, words=words)
    words = ("lies in this folder and would be replaced with it",)
    refused(*command, tmp_path, about=tmp_path, words=words)


def test_24_inputs_of_synth_and_paper_are_not_replaced(refused, capture):
    truth = capture / "truth" / "depth.tiff"
    words = ("the shape file lies in this folder",)
    refused("synth", capture, "--shape-file", truth, "--overwrite", about=capture, words=words)
    words = ("the texture lies in this folder",)
    texture = capture / "rgb" / "000.png"
    refused("synth", capture, "--texture", texture, "--overwrite", about=capture, words=words)
    words = ("into the capture, which is never changed",)
    inside = capture / "figure"
    refused("paper", "figure1", "--capture", capture, "-o", inside, about=inside, words=words)


# --- an older result that a killed run had moved aside ---


def killed_between_two_renames(result):
    result.rename(result.with_name(f".{result.name}.rakelight-0123abcd.old"))


def test_26_view_finds_a_result_that_was_moved_aside(run, result):
    report = (result / "report.html").as_uri()
    killed_between_two_renames(result)
    ran = run("view", result, "--print")
    assert (ran.code, ran.out) == (0, f"{report}\n")
    assert (result / "report.html").is_file()


def test_26_eval_finds_a_result_that_was_moved_aside(run, capture, result, tmp_path):
    before = contents(tmp_path)
    killed_between_two_renames(result)
    assert run("eval", result, "--truth", capture).code == 0
    assert contents(tmp_path) == before
    killed_between_two_renames(result)
    assert load_result(result).source.endswith("capture")


# --- an older folder that cannot be deleted ---


@pytest.fixture
def undeletable(monkeypatch):
    """The system deletes no older result, and no older capture or map."""
    rmdir = Path.rmdir

    def refused(self):
        if self.suffix == ".replaced":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        rmdir(self)

    monkeypatch.setattr(Path, "rmdir", refused)


@pytest.mark.parametrize("options", [(), ("--json",), ("--quiet",)])
@pytest.mark.parametrize("command", ["refine", "eval", "synth", "paper"])
@pytest.mark.usefixtures("capture", "result", "undeletable")
def test_26_an_older_folder_that_stays_is_said(run, tmp_path, command, options):
    arguments = command_into(command, tmp_path)
    assert run(*arguments, "--quiet").code == 0
    ran = run(*arguments, *options)
    (hidden,) = tmp_path.glob(".out.rakelight-*")
    assert ran.code == 0
    said = f"{hidden}: this folder of an earlier run could not be deleted (seen Permission denied)"
    if command == "refine" and options == ("--json",):
        assert said in [finding["message"] for finding in json.loads(ran.out)["findings"]]
    elif options == ("--quiet",):
        assert ran.err == ""
    else:
        assert f"warning: {said}. Fix: " in ran.err


def test_26_the_next_run_deletes_it(run, capture, result, tmp_path, monkeypatch):
    command = ("refine", capture, "-o", result, "--overwrite", "--quiet", *QUICK)
    with monkeypatch.context() as patch:
        patch.setattr(folders, "_delete_older", lambda *_: ())
        assert run(*command).code == 0
    assert len(list(tmp_path.iterdir())) == 3
    assert run(*command).code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture", "result"]
