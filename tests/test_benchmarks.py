"""The benchmarks can be called: their figures are made by hand, their options are checked here."""

import ast
import runpy
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest

from rakelight.synthetic import random_capture

FILES = sorted((Path(__file__).parents[1] / "benchmarks").glob("*.py"))
WITH_OPTIONS = [path for path in FILES if "ArgumentParser" in path.read_text()]


@pytest.mark.parametrize("path", WITH_OPTIONS, ids=lambda path: path.stem)
def test_each_says_what_it_takes(path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(path), "--help"])
    monkeypatch.syspath_prepend(str(path.parent))
    monkeypatch.syspath_prepend(str(path.parents[1]))
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(path), run_name="__main__")
    assert left.value.code == 0
    assert "usage:" in capsys.readouterr().out


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_what_each_imports_of_rakelight_exists(path):
    # Also what a function imports when it runs.
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rakelight"):
            module = import_module(node.module)
            for alias in node.names:
                found = hasattr(module, alias.name) or find_spec(f"{node.module}.{alias.name}")
                assert found, f"{node.module} has no {alias.name}"


def test_a_refinement_takes_longer_than_the_model_that_wins(monkeypatch):
    # It watches functions of the method by name.
    monkeypatch.syspath_prepend(str(FILES[0].parent))
    arguments = {"set": [("object_px", 3000.0), ("photographs", 4)], "beams": True}
    ratio = import_module("models_tried").ratio
    seconds, winner = ratio(6, SimpleNamespace(scans=(), pictures=(), **arguments))
    assert 0 < winner < seconds


def test_the_checks_warn_of_captures_made_wrong(monkeypatch):
    # It asks each check by the code of its finding, and runs those that refine runs.
    monkeypatch.syspath_prepend(str(FILES[0].parents[1]))
    capture, _ = random_capture(4000, size=0.3)
    said = import_module("benchmarks.checks").sayings(capture, wall=False)
    assert said["nothing", "depth-shifted"] == "silent"
    assert said["depth shifted", "depth-shifted"] != "silent"


def test_the_picture_of_the_shapes_shows_each_in_every_paint(monkeypatch):
    monkeypatch.syspath_prepend(str(FILES[0].parent))
    picture = import_module("shapes_picture")
    monkeypatch.setattr(picture, "SCALE", 0.1)
    assert picture.column("sphere").shape == (36 * (len(picture.ALBEDOS) + 1), 48, 3)


def test_a_missing_folder_for_pictures_is_one_line(monkeypatch, capsys, tmp_path):
    path = FILES[0].parent / "capture_pictures.py"
    monkeypatch.syspath_prepend(str(path.parent))
    monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path / "none"), "--topic", "none"])
    with pytest.raises(SystemExit):
        runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().err.endswith(f"error: there is no folder {tmp_path / 'none'}\n")
