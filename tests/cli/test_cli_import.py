"""`rakelight import`: what it reads, writes and says."""

import json

import numpy as np
import pytest

from rakelight import load_capture
from rakelight.capture.readers import find_reader, readers


def test_list_names_every_reader(run):
    ran = run("import", "--list")
    assert (ran.code, ran.err) == (0, "")
    assert [line.split()[0] for line in ran.out.splitlines()] == [r.name for r in readers()]


@pytest.mark.parametrize("options", [("--list", "--json"), ("--json", "--list")])
def test_the_list_as_json(run, options):
    ran = run("import", *options)
    assert (ran.code, ran.err) == (0, "")
    rows = json.loads(ran.out)["readers"]
    assert [(row["name"], row["reads"], row["extra"]) for row in rows] == [
        (reader.name, reader.reads, reader.extra) for reader in readers()
    ]


def test_a_capture_is_copied_bit_by_bit(run, capture, tmp_path):
    before, out = load_capture(capture), tmp_path / "copy"
    ran = run("import", capture, "-o", out, "--json")
    facts = json.loads(ran.out)
    assert (ran.code, facts["reader"]) == (0, "rakelight")
    assert facts["photographs"] == len(before.photographs)
    after = load_capture(out)
    assert np.array_equal(after.photographs, before.photographs)
    assert np.array_equal(after.depth_m, before.depth_m, equal_nan=True)
    assert np.array_equal(after.mask, before.mask)
    assert after.camera == before.camera


def test_an_unknown_file_is_refused_in_one_line(run, tmp_path):
    file = tmp_path / "notes.txt"
    file.write_text("nothing")
    ran = run("import", file, "-o", tmp_path / "out")
    assert ran.code == 2
    assert ran.err.startswith(f"error: {file}: this kind of file is not read")
    assert ran.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_what_looks_like_a_capture_is_left_to_that_reader(tmp_path):
    (tmp_path / "c" / "rgb").mkdir(parents=True)
    assert find_reader(tmp_path / "c").name == "rakelight"
