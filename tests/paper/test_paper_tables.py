"""The paper's tables: what is in them, in every format, and the command that makes them."""

import csv
import io
import json
import re
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
import pytest

from rakelight.capture.images import decode_image
from rakelight.cli import main
from rakelight.methods import load_method
from rakelight.paper.rows import ROWS
from rakelight.paper.scenes import PAPER_OPTIONS, SCENARIOS, paper_object, paper_scene
from rakelight.paper.table1 import Cell, table1, table1_markdown
from rakelight.paper.table2 import table2, table2_markdown
from rakelight.paper.write import as_csv, as_json

KEYS = ("method", "scenario", "rmse_mm", "mae_deg", "paper_rmse_mm", "paper_mae_deg")
PRINTED = {
    "input reference": ((3.3305, 16.3096), (3.3305, 16.3096), (3.3305, 16.3096)),
    "RGB-Fusion (no smooth)": ((3.3418, 18.9115), (3.3872, 27.0026), (3.3411, 25.6574)),
    "RGB-Fusion": ((3.1751, 17.2197), (3.1890, 18.4722), (3.1708, 18.0850)),
    "Fusion-like (not smooth)": ((3.3475, 17.5911), (3.3459, 23.4808), (3.3898, 35.2610)),
    "RGB ratio": ((1.9437, 5.0574), (2.9116, 17.5238), (3.1006, 21.2286)),
    "robust multi-light (as published)": ((2.3125, 3.8708), (1.5794, 1.7368), (1.8424, 2.6815)),
}
"""Table 1 of the paper, as printed."""

INPUT, ALTERNATING = (
    next(row for row in ROWS if row.method == name) for name in (None, "multi-light-alternating")
)
FEW = (INPUT, ALTERNATING)


@cache
def few(table, size):
    """A table of the few rows, made once for each size."""
    return table(size=size, rows=FEW)


@pytest.fixture(scope="module")
def small():
    """Table 1 at 96 x 72 with a method that there is and one that there is not."""
    return few(table1, 0.15)


@pytest.fixture
def run(capfd, tmp_path, monkeypatch):
    """Run `rakelight paper ARGUMENTS` on the few rows: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    for name, table in (("table1", table1), ("table2", table2)):
        monkeypatch.setattr(f"rakelight.paper.{name}.{name}", partial(table, rows=FEW))

    def run(*arguments):
        with pytest.raises(SystemExit) as left:
            main(["paper", *arguments])
        return (left.value.code, *capfd.readouterr())

    return run


@pytest.fixture
def made_before(run, monkeypatch):
    """The tables that `run` asks for are made once: how they are written is looked at."""

    def again(table):
        return lambda size, **_: few(table, size)

    for name, table in (("table1", table1), ("table2", table2)):
        monkeypatch.setattr(f"rakelight.paper.{name}.{name}", again(table))


def rows_of(text):
    """The cells of a Markdown table, line by line."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


# --- rows and scenes


def test_the_papers_six_rows_come_first_with_its_numbers():
    assert {row.label: row.paper for row in ROWS[:6]} == PRINTED
    assert [row.label for row in ROWS[:6]] == list(PRINTED)
    assert all(row.paper is None for row in ROWS[6:])


def test_every_method_sees_the_light_that_it_is_for():
    methods = [row for row in ROWS if row.method]
    assert all(row.lighting == load_method(row.method).lighting for row in methods)


def test_one_object_and_one_depth_map_for_every_lamp_and_paint():
    bust = paper_object()
    scenes = [paper_scene(s, "moving-lamp", 0.1, bust) for s in SCENARIOS]
    scenes += [paper_scene("simple", lighting, 0.1) for lighting in ("rgb-leds", "ambient")]
    (first, truth), *others = scenes
    for capture, also_true in others:
        assert np.array_equal(capture.depth_m, first.depth_m, equal_nan=True)
        assert np.array_equal(capture.mask, first.mask)
        assert np.array_equal(also_true.normals, truth.normals, equal_nan=True)
    paints = [known.albedo for _, known in scenes[:3]]
    assert all(np.abs(a - b).max() > 0.1 for a, b in pairwise(paints))
    assert np.array_equal(scenes[3][1].albedo, paints[0])


def test_the_shared_object_is_traced_once():
    bust = paper_object()
    assert bust.render(bust.camera.scaled(0.1)) is bust.render(bust.camera.scaled(0.1))


def test_the_input_row_is_the_papers(monkeypatch):
    """PAPER_NOISE at full size; neither lights nor paint matter to it.

    One photograph will do, of one ray a pixel.
    """
    monkeypatch.setattr(
        "rakelight.paper.scenes.PAPER_OPTIONS", replace(PAPER_OPTIONS, supersampling=1)
    )
    monkeypatch.setattr("rakelight.paper.table1.SCENARIOS", ("simple",))
    (cell,) = table1(rows=[replace(INPUT, lighting="ambient")]).cells
    assert cell.rmse_mm == pytest.approx(3.3305, rel=0.03)
    assert cell.mae_deg == pytest.approx(16.3096, rel=0.03)


# --- table 1


def test_a_cell_for_every_row_and_scenario(small):
    places = [(cell.method, cell.scenario) for cell in small.cells]
    assert places == [(row.label, scenario) for row in FEW for scenario in SCENARIOS]
    for cell in small.cells:
        row = next(row for row in FEW if row.label == cell.method)
        printed = row.paper[SCENARIOS.index(cell.scenario)]
        assert (cell.paper_rmse_mm, cell.paper_mae_deg) == printed
        assert 0 < cell.rmse_mm < 5
        assert 0 < cell.mae_deg < 25


def test_photographs_improve_the_normals(small):
    mae = {(cell.method, cell.scenario): cell.mae_deg for cell in small.cells}
    for scenario in SCENARIOS:
        assert mae[ALTERNATING.label, scenario] < mae[INPUT.label, scenario]


def test_a_picture_for_every_scenario_shows_truth_and_rows(small):
    assert list(small.pictures) == list(SCENARIOS)
    (width,) = {picture.shape[1] for picture in small.pictures.values()}
    assert (width + 16) % 3 == 0  # three pictures and two gaps of 16 pixels


def test_json_has_the_stated_keys(small):
    content = json.loads(as_json(small.cells))
    assert list(content) == ["rows"]
    assert all(tuple(row) == KEYS for row in content["rows"])
    assert [Cell(**row) for row in content["rows"]] == list(small.cells)


def test_csv_says_what_json_says(small):
    head, *lines = csv.reader(io.StringIO(as_csv(small.cells)))
    assert tuple(head) == KEYS
    for line, row in zip(lines, json.loads(as_json(small.cells))["rows"], strict=True):
        assert line[:2] == [row["method"], row["scenario"]]
        numbers = [float(text) if text else None for text in line[2:]]
        assert numbers == [row[key] for key in KEYS[2:]]


def test_markdown_says_what_json_says(small):
    text = table1_markdown(small.cells)
    head, _, *lines = rows_of(text)
    assert head == ["method"] + [
        f"{scenario} {what}" for scenario in SCENARIOS for what in ("RMSE, mm", "MAE, deg")
    ]
    cells = iter(small.cells)
    for line, row in zip(lines, FEW, strict=True):
        expected = [row.label]
        for cell in (next(cells) for _ in SCENARIOS):
            for ours, paper in (
                (cell.rmse_mm, cell.paper_rmse_mm),
                (cell.mae_deg, cell.paper_mae_deg),
            ):
                expected.append(f"{ours:.2f} ({paper:.2f})")
        assert line == expected
    assert "In brackets: the paper's own numbers." in text


def test_a_row_that_is_ours_alone_has_no_brackets():
    cells = [Cell("ours", scenario, 1.0, 2.0, None, None) for scenario in SCENARIOS]
    assert rows_of(table1_markdown(cells))[2] == ["ours"] + ["1.00", "2.00"] * 3
    assert as_csv(cells).splitlines()[1] == "ours,simple,1.0,2.0,,"


# --- table 2


def test_table2_has_a_time_and_parameters_for_every_method():
    rows = few(table2, 0.1)
    assert [row.method for row in rows] == [ALTERNATING.label]
    (timed,) = rows
    assert 0 < timed.seconds < 60
    assert timed.parameters == 4
    assert timed.paper_seconds == 52.82
    head, _, first = rows_of(table2_markdown(rows))
    assert head == ["method", "seconds", "parameters"]
    assert first == [ALTERNATING.label, f"{timed.seconds:.2f} (52.82)", "4"]
    keys = ["method", "seconds", "parameters", "paper_seconds"]
    assert as_csv(rows).splitlines()[0].split(",") == keys
    assert [list(row) for row in json.loads(as_json(rows))["rows"]] == [keys]


# --- the command


def test_the_command_writes_the_table_in_three_formats(run, tmp_path, small):
    """It is made once more: two runs give the same bytes."""
    code, out, err = run("table1", "--size", "0.15", "-o", "made", "--json")
    assert (code, err) == (0, "")
    assert out == as_json(small.cells) + "\n"
    made = tmp_path / "made"
    pictures = {f"table1_{scenario}.png" for scenario in SCENARIOS}
    assert {path.name for path in made.iterdir()} == pictures | {
        "rakelight-files.json",
        *(f"table1.{kind}" for kind in ("md", "csv", "json")),
    }
    assert (made / "table1.json").read_text() == as_json(small.cells)
    assert (made / "table1.csv").read_text() == as_csv(small.cells)
    assert (made / "table1.md").read_text() == table1_markdown(small.cells)
    for scenario, picture in small.pictures.items():
        again = decode_image((made / f"table1_{scenario}.png").read_bytes())
        assert np.array_equal(again, picture)


@pytest.mark.usefixtures("made_before")
def test_an_older_table_is_replaced_only_when_asked(run, tmp_path):
    command = ("table1", "--size", "0.15", "-o", "made", "--quiet")
    assert run(*command) == (0, "", "")
    before = (tmp_path / "made/table1.json").stat().st_ino
    code, out, err = run(*command)
    assert (code, out) == (2, "")
    assert re.fullmatch(r"error: made: the folder exists.*--overwrite\n", err)
    assert (tmp_path / "made/table1.json").stat().st_ino == before
    assert run(*command, "--overwrite") == (0, "", "")
    assert (tmp_path / "made/table1.json").stat().st_ino != before


@pytest.mark.parametrize("file", ["table1.json", "table2.json", "thesis.tex"])
def test_no_other_folder_is_replaced(run, tmp_path, file):
    (tmp_path / "made").mkdir()
    (tmp_path / "made" / file).write_text("mine")
    code, out, err = run("table1", "--size", "0.1", "-o", "made", "--overwrite")
    assert (code, out) == (2, "")
    assert "is not overwritten" in err
    assert [path.name for path in (tmp_path / "made").iterdir()] == [file]


@pytest.mark.usefixtures("made_before")
def test_the_command_prints_markdown_and_where_it_is(run, tmp_path):
    code, out, err = run("table2", "--size", "0.1", "-o", "made")
    assert (code, err) == (0, "")
    assert out == (tmp_path / "made/table2.md").read_text() + "\nwritten to made\n"
    assert {path.name for path in (tmp_path / "made").iterdir()} == {
        "rakelight-files.json",
        "table2.md",
        "table2.csv",
        "table2.json",
    }


@pytest.mark.parametrize("size", ["0", "-1", "0.09", "4.1", "nan", "inf"])
def test_an_impossible_size(run, tmp_path, size):
    code, out, err = run("table1", "--size", size, "-o", "made")
    assert (code, out) == (2, "")
    assert err.startswith("error: --size: not a size")
    assert not (tmp_path / "made").exists()
