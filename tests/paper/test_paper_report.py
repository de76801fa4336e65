"""paper.md: every claim has its verdict and its numbers, all from the rows; the command for it."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from rakelight.cli import main
from rakelight.paper.figure2 import Explanation
from rakelight.paper.figure6 import SHINY, Shining
from rakelight.paper.figure7 import Count, Time
from rakelight.paper.figure8 import LAMBERTIAN, Shape
from rakelight.paper.make import NAMES
from rakelight.paper.report import INPUT, JOINT, LDR_PS, PUBLISHED, SINGLE, claims, page
from rakelight.paper.scenarios import Paint
from rakelight.paper.scenes import PAPER_OPTIONS, SCENARIOS
from rakelight.paper.sheet import SECONDS, Sheet
from rakelight.paper.table1 import Cell, table1_markdown
from rakelight.paper.table2 import Runtime, table2_markdown
from rakelight.pipeline import refine

ANGLES = {
    INPUT: (16.0, 16.0, 16.0),
    SINGLE[0]: (14.0, 20.0, 22.0),
    SINGLE[1]: (11.0, 15.0, 17.0),
    SINGLE[2]: (14.1, 20.1, 22.1),
    SINGLE[3]: (4.0, 9.0, 17.5),
    PUBLISHED: (2.8, 2.7, 2.9),
    JOINT: (1.7, 1.6, 1.8),
    LDR_PS: (4.4, 4.1, 12.9),
}
FLIPS = {  # what makes each claim wrong: sheet, which rows, field, value
    "a": ("table1", lambda r: r.method == SINGLE[1], "mae_deg", 30.0),
    "b": ("table1", lambda r: r.scenario == "complicated", "mae_deg", 1.0),
    "c": ("table1", lambda r: r.method == PUBLISHED, "mae_deg", 12.0),
    "d": ("table2", lambda r: r.method == SINGLE[2], "parameters", 40),
    "e": ("figure7", lambda r: r.photographs == 30, "mae_deg", 9.0),
    "f": ("figure6", lambda r: r.surface == PUBLISHED, "highlight_mae_deg", 50.0),
    "g": ("figure8", lambda r: r.method == LDR_PS, "jump_percent", 95.0),
    "h": ("figure2", lambda r: r.explanation == "light", "largest_difference", 7),
}


def small(name, rows, **more):
    picture = np.zeros((4, 6), np.uint8)
    return Sheet(name, f"Title of {name}", rows, {"": picture}, more)


@pytest.fixture
def sheets():
    """What a run could have given that supports every claim."""
    cells = [
        Cell(label, scenario, 3.0, angle, None, None)
        for label, angles in ANGLES.items()
        for scenario, angle in zip(SCENARIOS, angles, strict=True)
    ]
    times = [Runtime(label, 1.0 + k, 8 + k, None) for k, label in enumerate(ANGLES)][1:]
    times = [replace(r, parameters=5) if r.method == SINGLE[2] else r for r in times]
    paints = [
        Paint(label, s, 0.1, 0.9 - 0.1 * k)
        for k, label in enumerate((PUBLISHED, *SINGLE))
        for s in SCENARIOS
    ]
    light = [Explanation(name, 1.0, 0.0, 0.0, 67741, 0) for name in ("paint", "shape", "light")]
    shining = [
        Shining(shape, count, surface, 3.0, 10.0, angle, 8.0)
        for shape in ("vase", "head")
        for count in (4, 12)
        for surface, angle in (("input", 20.0), (SINGLE[1], 25.0), (PUBLISHED, 9.0), (JOINT, 8.0))
    ]
    counts = [
        Count(label, n, 2.0 - n / 100, 2.6 + 10 / n**2, 5)
        for label in (PUBLISHED, JOINT)
        for n in (4, 10, 20, 30)
    ]
    seconds = [
        Time(c.method, c.photographs, c.photographs / 7, 0.123 * c.photographs) for c in counts
    ]
    shapes = [Shape(PUBLISHED, 1.9, 1.8, 2.7, 2.6, 66.0), Shape(JOINT, 1.2, 0.8, 1.6, 1.3, 102.0)]
    shapes.append(Shape(LDR_PS, 8.7, 7.8, 4.1, 2.8, 28.0))
    shapes.append(Shape(LAMBERTIAN, 9.7, 8.8, 2.7, 2.3, 33.0))
    made = {
        "table1": replace(small("table1", cells), markdown=table1_markdown(cells)),
        "table2": replace(small("table2", times), markdown=table2_markdown(times)),
        "scenarios": small("scenarios", paints),
        "figure2": small("figure2", light),
        "figure6": small("figure6", shining),
        "figure7": small("figure7", counts, **{SECONDS: seconds}),
        "figure8": small("figure8", shapes),
    }
    pictures = {"": made["figure7"].pictures[""], SECONDS: made["figure7"].pictures[""]}
    made["figure7"] = replace(made["figure7"], pictures=pictures)
    return made


def changed(sheets, name, which, field, value):
    rows = [replace(r, **{field: value}) if which(r) else r for r in sheets[name].rows]
    return {**sheets, name: replace(sheets[name], rows=rows)}


def test_every_claim_holds_where_all_speaks_for_it(sheets):
    found = claims(sheets)
    assert "".join(each.letter for each in found) == "abcdefgh"
    assert {each.letter: each.verdict for each in found} == dict.fromkeys("abcdefgh", "supported")


@pytest.mark.parametrize("letter", FLIPS)
def test_a_claim_falls_with_its_numbers(sheets, letter):
    name, which, field, value = FLIPS[letter]
    before = {each.letter: each for each in claims(sheets)}
    after = {each.letter: each for each in claims(changed(sheets, name, which, field, value))}
    assert after[letter].verdict != "supported"
    assert after[letter].found != before[letter].found
    shown = f"{value:.2f}" if field == "mae_deg" else f"{value:.0f}"
    assert shown in after[letter].found


def test_the_page_has_every_claim_and_picture(sheets):
    found = claims(sheets)
    files = page(sheets, found, 1.0)
    text = files["paper.md"].decode()
    for each in found:
        for part in (each.claim, each.found, each.reason):
            assert part in text
    assert "640 x 480 pixels, 12 lights" in text
    linked = set(re.findall(r"\]\(([^)]+)\)", text))
    assert linked == set(files) - {"paper.md"}
    for name in ("table1", "figure8"):
        assert sheets[name].text.rstrip() in text


def test_times_stand_below_their_heading_only(sheets):
    slower = changed(sheets, "table2", lambda _: True, "seconds", 1234.5)
    seconds = [
        replace(each, core_seconds_per_iteration=77.0) for each in sheets["figure7"].more[SECONDS]
    ]
    slower["figure7"] = replace(sheets["figure7"], more={SECONDS: seconds})
    first, second = (page(s, claims(s), 1.0)["paper.md"].decode() for s in (sheets, slower))
    (above, below), (above_too, below_too) = (t.split("## Timings") for t in (first, second))
    assert above == above_too
    assert below != below_too
    assert "1234.50" in below_too
    assert claims(slower) == claims(sheets)


# ---- the command


@pytest.fixture
def run(capfd, tmp_path, monkeypatch):
    """Run `rakelight paper ARGUMENTS`: (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as left:
            main(["paper", *arguments])
        return (left.value.code, *capfd.readouterr())

    return run


def test_a_figure_goes_into_a_folder(run, tmp_path):
    code, out, err = run("figure2", "-o", "made", "--size", "0.1", "--json")
    assert (code, err) == (0, "")
    names = {f"figure2.{kind}" for kind in ("md", "csv", "json", "png")}
    assert {path.name for path in (tmp_path / "made").iterdir()} == names | {"rakelight-files.json"}
    assert len(json.loads(out)["rows"]) == 3
    assert run("figure2", "-o", "made", "--size", "0.1", "--overwrite", "--quiet") == (0, "", "")


def test_a_capture_for_what_shows_none(run, tmp_path):
    code, out, err = run("table1", "-o", "made", "--capture", "nowhere")
    assert (code, out) == (2, "")
    assert "--capture: table1 is of synthetic captures alone" in err


def test_a_capture_that_is_not_there(run, tmp_path):
    code, out, err = run("figure3", "-o", "made", "--size", "0.1", "--capture", "nowhere")
    assert (code, out) == (2, "")
    assert err.startswith("error: nowhere")
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("what", ["figure7", "all"])
def test_without_matplotlib_the_extra_is_named_before_any_work(run, monkeypatch, tmp_path, what):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, out, err = run(what, "-o", "made")
    assert (code, out) == (3, "")
    assert "rakelight[paper]" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "made").exists()


def refined_briefly(capture, method, *, options, **rest):
    """A step or two of every method, without a choice: what is written does not depend on them."""
    brief = {"max_iterations": 1, "lights": "white", "distance": "distant"}
    known = {name: value for name, value in brief.items() if hasattr(options, name)}
    options = replace(options, **known)
    return refine(capture, method, options=options, **rest)


def test_all_of_it_with_one_command(run, monkeypatch, tmp_path):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("rakelight.paper.rows.refine", refined_briefly)
    monkeypatch.setattr("rakelight.paper.figure7.COUNTS", (4, 6))
    monkeypatch.setattr("rakelight.paper.figure6.OBJECTS", ("vase",))
    quick = replace(PAPER_OPTIONS, supersampling=1, photographs=5)
    for module in ("scenes", "figure3", "figure7", "figure8"):
        monkeypatch.setattr(f"rakelight.paper.{module}.PAPER_OPTIONS", quick)
    monkeypatch.setattr("rakelight.paper.figure6.SHINY", replace(SHINY, supersampling=1))
    code, out, err = run("all", "-o", "made", "--size", "0.1", "--json")
    assert (code, err) == (0, "")
    made = {str(path.relative_to(tmp_path / "made")) for path in (tmp_path / "made").rglob("*.*")}
    for name in NAMES:
        assert {f"{name}.md", f"{name}.csv", f"{name}.json"} <= made
    assert {f"figure{number}.png" for number in range(1, 9)} <= made
    text = (tmp_path / "made/paper.md").read_text()
    assert set(re.findall(r"\]\(([^)]+)\)", text)) <= made
    assert [row["letter"] for row in json.loads(out)["rows"]] == list("abcdefgh")
    assert out == (tmp_path / "made/paper.json").read_text() + "\n"
