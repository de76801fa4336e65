"""The examples run as they stand, and do what they say."""

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run an example in an empty folder: (its names, what it printed)."""

    def run(name):
        monkeypatch.chdir(tmp_path)
        names = runpy.run_path(str(FOLDER / name), run_name="__main__")
        assert list(tmp_path.iterdir()) == []  # they leave nothing behind
        out, err = capsys.readouterr()
        assert err == ""
        return names, out

    return run


def test_there_is_a_test_for_each():
    assert [path.name[:2] for path in EXAMPLES] == ["01", "02", "03", "04", "05"]
    tests = Path(__file__).read_text(encoding="utf-8")
    assert [path.name for path in EXAMPLES if f'run("{path.name}")' not in tests] == []


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_each_says_how_it_is_run(path):
    assert f"python examples/{path.name}\n" in path.read_text(encoding="utf-8")


def test_folder(run):
    names, out = run("01_folder.py")
    assert "multi-light: 120 x 90, " in out
    assert "report.html" in out
    assert names["again"].method == names["result"].method


def test_arrays(run):
    names, out = run("02_arrays.py")
    result = names["result"]
    assert result.depth.shape == names["photographs"].shape[1:3]
    assert len(names["mesh"].vertices_m) > 2000
    assert "refused: depth: whole numbers without a unit (seen uint16" in out
    assert "Fix: depth / 1000.0" in out


def test_options(run):
    _, out = run("03_options.py")
    methods = [line.split()[0] for line in out.splitlines()]
    assert methods == ["multi-light", "multi-light", "multi-light-alternating", "fusion-like"]
    moved_mm = [float(line.split()[-2]) for line in out.splitlines()]
    assert moved_mm[0] > moved_mm[1] > 0  # weighed more, the sensor's depth stays nearer


def test_own_method(run):
    names, out = run("04_own_method.py")
    before, after, result = names["before"], names["after"], names["result"]
    assert (result.method, result.options["rounds"]) == ("small", 8)
    assert result.iterations == 7
    assert result.energy[-1] < 0.7 * result.energy[0]
    assert after.normals.mae_deg < 0.85 * before.normals.mae_deg
    assert after.depth.rmse_mm < before.depth.rmse_mm
    assert "small, " in out


def test_evaluate(run):
    names, out = run("05_evaluate.py")
    before, after, best = names["before"], names["after"], names["best"]
    assert after.normals.mae_deg < 0.5 * before.normals.mae_deg
    assert after.depth.rmse_mm < before.depth.rmse_mm
    assert best.depth.rmse_mm < after.depth.rmse_mm
    assert f"{after.normals.mae_deg:.2f} deg" in out
