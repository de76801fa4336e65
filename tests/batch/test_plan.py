"""From arguments to jobs: patterns, lists, URLs, and names that stay."""

import os

import pytest

from rakelight.batch.plan import Job, clean_name, make_jobs
from rakelight.errors import InputError


def names(*sources, **options):
    return [job.name for job in make_jobs([os.fspath(each) for each in sources], **options)]


def test_a_pattern_is_expanded_in_order(tmp_path):
    for name in ("b", "a", "c.bag", ".hidden"):
        (tmp_path / name).mkdir()
    jobs = make_jobs([f"{tmp_path}/*"])
    assert [job.source for job in jobs] == [f"{tmp_path}/{name}" for name in ("a", "b", "c.bag")]
    with pytest.raises(InputError, match=r"nothing matches .* Fix: "):
        make_jobs([f"{tmp_path}/*.mat"])


def test_a_name_with_brackets_is_no_pattern_where_it_exists(tmp_path):
    (tmp_path / "coin [1]").mkdir()
    assert names(tmp_path / "coin [1]") == ["coin [1]"]


def test_a_list_names_captures_from_its_own_folder(tmp_path, monkeypatch):
    for name in ("one", "two", "three"):
        (tmp_path / "lists" / "in" / name).mkdir(parents=True)
    text = "\ufeff# today\n\nin/one\n  in/t*\n/else/four\n"
    (tmp_path / "lists" / "all.txt").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    jobs = make_jobs(["lists/all.txt"])
    assert [job.name for job in jobs] == ["one", "three", "two", "four"]
    assert jobs[0].source == f"{tmp_path}/lists/in/one"
    assert jobs[-1].source == "/else/four"


@pytest.mark.parametrize("coding", ["utf-16-le", "utf-16-be", "utf-8"])
def test_a_list_may_be_in_utf_16_as_powershell_writes_it(tmp_path, coding):
    (tmp_path / "bük").mkdir()
    text = "\ufeff# made by dir\r\nbük\r\n"
    (tmp_path / "all.txt").write_bytes(text.encode(coding))
    assert names(tmp_path / "all.txt") == ["bük"]


@pytest.mark.parametrize("text", ["", "# none\n\n"])
def test_an_empty_list_is_refused(tmp_path, text):
    (tmp_path / "all.txt").write_text(text)
    with pytest.raises(InputError, match="a list without captures"):
        make_jobs([f"{tmp_path}/all.txt"])


def test_an_empty_name_is_not_the_working_directory(tmp_path):
    with pytest.raises(InputError, match="CAPTURE: the name is empty"):
        make_jobs([str(tmp_path), ""])


def test_a_capture_is_done_once_however_it_is_named(tmp_path, monkeypatch):
    (tmp_path / "coin").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "coin")
    monkeypatch.chdir(tmp_path)
    assert names("coin", "./coin/", tmp_path / "coin", "c*n", "link") == ["coin"]


def test_captures_of_one_name_get_names_of_their_own(tmp_path):
    apart = names("/a/coin", "/b/coin", "/b/head")
    assert apart[2] == "head"
    assert len(set(apart)) == 3
    assert all(name.startswith("coin-") for name in apart[:2])
    # whatever else is named, and in whichever order
    assert names("/c/coin", "/b/coin", "/a/coin")[1:] == apart[1::-1]
    assert names("/a/Coin", "/b/coin") == ["Coin-" + names("/a/Coin", "/b/coin")[0][5:], apart[1]]


def test_a_capture_keeps_the_name_that_it_had():
    first = make_jobs(["/a/coin"])
    earlier = {job.shown: job.name for job in first}
    later = make_jobs(["/b/coin", "/a/coin"], earlier)
    assert later[1] == first[0] == Job("/a/coin", "coin")
    assert later[0].name.startswith("coin-")


@pytest.mark.parametrize(
    ("source", "start"),
    [
        ("/a/index.html", "index.html-"),
        ("/a/BATCH.json", "BATCH.json-"),
        ("/a/x\ny", "x_y-"),
        ("/a/caf\udce9", "caf_-"),
        ("/a/-rf", "_rf-"),
        ("/a/..coin", "_.coin-"),
        ("/a/coin. ", "coin-"),
        ("/a/" + "ü" * 120, "ü" * 75 + "-"),
    ],
)
def test_names_that_would_not_do(source, start):
    (name,) = names(source)
    assert name.startswith(start)
    assert len(name) == len(start) + 8
    assert len(name.encode()) < 200


def test_urls():
    urls = ["s3://bucket/a/coin", "https://museum.example/b/oven%20mitten/?v=2"]
    jobs = make_jobs(urls)
    assert [job.name for job in jobs] == ["coin", "oven mitten"]
    assert [job.source for job in jobs] == urls
    assert all(job.remote for job in jobs)
    assert not make_jobs(["coin"])[0].remote


def test_a_path_with_a_zero_byte_is_refused():
    with pytest.raises(InputError, match="not a usable path"):
        make_jobs(["a\0b"])


def test_the_same_name_cleaned_twice_stays():
    assert clean_name("/a/" + clean_name("/b/x:y*")) == "x_y_"


def test_a_link_gives_its_name(tmp_path):
    for day in ("monday", "tuesday"):
        (tmp_path / day[0] / "capture").mkdir(parents=True)
        (tmp_path / day).symlink_to(tmp_path / day[0] / "capture")
    (tmp_path / "wednesday").symlink_to(tmp_path / "w")
    jobs = make_jobs([f"{tmp_path}/*day"])
    assert [job.name for job in jobs] == ["monday", "tuesday", "wednesday"]
    assert [job.shown for job in jobs] == [f"{tmp_path}/{job.name}" for job in jobs]
    # by the link and by itself, in either order: once, by its own name
    assert names(tmp_path / "monday", tmp_path / "m" / "capture") == ["capture"]
    assert names(tmp_path / "m" / "capture", tmp_path / "monday") == ["capture"]


def test_what_was_named_by_its_place_keeps_that_name(tmp_path):
    (tmp_path / "d" / "capture").mkdir(parents=True)
    (tmp_path / "monday").symlink_to(tmp_path / "d" / "capture")
    by_place = {os.fspath(tmp_path / "d" / "capture"): "capture-0c23201f"}
    assert names(tmp_path / "monday", earlier=by_place) == ["capture-0c23201f"]
    by_link = {os.fspath(tmp_path / "monday"): "monday"}
    assert names(tmp_path / "d" / "capture", earlier=by_link) == ["monday"]


def test_the_way_back_through_a_link_is_not_cut_short(tmp_path):
    (tmp_path / "far" / "inner").mkdir(parents=True)
    (tmp_path / "near").symlink_to(tmp_path / "far" / "inner")
    (job,) = make_jobs([f"{tmp_path}/near/.."])
    assert (job.source, job.name) == (os.fspath(tmp_path / "far"), "far")


def test_a_text_that_names_nothing_is_no_list(tmp_path):
    (tmp_path / "coin").mkdir()
    notes = tmp_path / "notes.txt"
    notes.write_text("# Monday\nthe lamp was *hot*, was it?\nall\0 well\n")
    with pytest.raises(InputError, match="not a list of captures") as caught:
        names(tmp_path / "coin", notes)
    assert caught.value.source == os.fspath(notes)
    assert caught.value.seen == "line 2: the lamp was *hot*, was it?"


def test_a_line_that_is_wrong_is_named(tmp_path):
    (tmp_path / "coin").mkdir()
    (tmp_path / "link").symlink_to("nowhere")
    path = tmp_path / "all.txt"
    path.write_text("coin\n\ncion\nlink\n")
    assert [job.line for job in make_jobs([f"{path}"])] == [
        "",
        f"{path}, line 3",
        f"{path}, line 4",
    ]
    for wrong, message in (("c?n", "nothing matches"), ("a\0b", "not a usable path")):
        path.write_text(f"coin\n{wrong}\n")
        with pytest.raises(InputError, match=message) as caught:
            make_jobs([f"{path}"])
        assert caught.value.source == f"{path}, line 2: {wrong}"
