"""One job: what is done is known again, what changed is said, failures are answers."""

import json
import os
from functools import partial

import pytest

from rakelight.batch.one import STAMP, run_one, stamp_of
from rakelight.batch.plan import Job
from rakelight.cli.settings import options_with
from rakelight.export import read_summary
from rakelight.export.summary import program_version
from rakelight.recipe import Recipe

# Quick: no method iterates less.
QUICK = {"max_iterations": "1"}


def recipe(settings=QUICK, **options):
    named = {**settings}
    return Recipe(
        method="multi-light-alternating",
        settings=tuple(named.items()),
        options_for=partial(options_with, settings=named),
        **options,
    )


def do(capture, out, wanted=None, overwrite=False, version=None):
    job = Job(os.fspath(capture), "coin")
    return run_one(job, str(out), wanted or recipe(), overwrite, version or program_version())


@pytest.fixture
def done(capture, tmp_path):
    """The folder of a batch in which the capture was done once."""
    entry = do(capture, tmp_path / "out")
    assert (entry.state, entry.computed, entry.message) == ("done", True, "")
    return tmp_path / "out"


def test_a_result_is_whole_and_stamped(capture, done):
    summary = read_summary(done / "coin")
    assert summary.options["max_iterations"] == 1
    assert {STAMP, "report.html"} <= set(summary.files)
    assert {path.name for path in (done / "coin").iterdir()} == set(summary.files)
    stamp = json.loads((done / "coin" / STAMP).read_text())
    assert (stamp["source"], stamp["settings"]) == (str(capture), QUICK)
    assert stamp["checksum"] == stamp_of(done / "coin")


def test_what_is_done_is_not_done_again(capture, done):
    before = (done / "coin").stat().st_ino
    entry = do(capture, done)
    assert (entry.state, entry.computed) == ("done", False)
    assert 0 < entry.cpu_s < 60
    assert entry.figures.photographs == 4
    assert (done / "coin").stat().st_ino == before


def changed_input(capture, done):
    (capture / "note.txt").write_text("x")
    return do(capture, done)


def other_options(capture, done):
    return do(capture, done, recipe({"max_iterations": "2"}))


def other_files(capture, done):
    return do(capture, done, recipe(mesh="none"))


@pytest.mark.parametrize("again", [changed_input, other_options, other_files])
def test_a_result_of_something_else_is_not_replaced_unasked(capture, done, again):
    before = stamp_of(done / "coin")
    entry = again(capture, done)
    assert (entry.state, entry.exit_code) == ("failed", 2)
    assert "another input, other options or another version" in entry.message
    assert "--overwrite" in entry.message
    assert stamp_of(done / "coin") == before


def test_it_is_replaced_when_asked(capture, done):
    before = stamp_of(done / "coin")
    entry = do(capture, done, recipe({"max_iterations": "2"}), overwrite=True)
    assert (entry.state, entry.computed) == ("done", True)
    assert stamp_of(done / "coin") == entry.checksum != before


def test_another_version_counts(capture, done, monkeypatch):
    for module in ("batch.one", "recipe"):
        monkeypatch.setattr(f"rakelight.{module}.program_version", lambda: "9.9")
    entry = do(capture, done, version="9.9")
    assert "another version" in entry.message


def test_a_worker_of_another_version_refuses(capture, tmp_path):
    entry = do(capture, tmp_path / "out", version="9.9")
    assert (entry.state, entry.exit_code) == ("failed", 3)
    assert "needed 9.9" in entry.message
    assert not (tmp_path / "out").exists()


def test_a_result_that_lost_a_file_is_made_again(capture, done):
    (done / "coin" / "depth.tiff").unlink()
    entry = do(capture, done)
    assert (entry.state, entry.computed) == ("done", True)
    assert (done / "coin" / "depth.tiff").is_file()


def emptied(path):
    path.write_bytes(b"")


def cut_off(path):
    path.write_bytes(path.read_bytes()[:-1])


def of_the_same_size(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("damage", [emptied, cut_off, of_the_same_size])
@pytest.mark.parametrize("name", ["depth.tiff", "report.html"])
def test_a_result_of_which_a_file_was_damaged_is_made_again(capture, done, name, damage):
    path = done / "coin" / name
    before = path.read_bytes()
    damage(path)
    entry = do(capture, done)
    assert (entry.state, entry.computed) == ("done", True)
    assert len(path.read_bytes()) > 0.9 * len(before)
    assert not do(capture, done).computed


def test_a_result_without_checksums_counts_by_the_files_that_are_there(capture, done):
    """As versions before wrote it."""
    path = done / "coin" / "result.json"
    summary = json.loads(path.read_text())
    del summary["checksums"]
    path.write_text(json.dumps(summary))
    assert not do(capture, done).computed


@pytest.mark.parametrize("stamp", [b"", b"[]", b"{", b"[" * 100_000])
def test_a_damaged_stamp_is_none(done, stamp):
    (done / "coin" / STAMP).write_bytes(stamp)
    assert stamp_of(done / "coin") is None


def test_a_folder_of_somebody_else_is_never_replaced(capture, tmp_path):
    (tmp_path / "out" / "coin").mkdir(parents=True)
    (tmp_path / "out" / "coin" / "thesis.docx").write_text("x")
    entry = do(capture, tmp_path / "out", overwrite=True)
    assert (entry.state, entry.exit_code) == ("failed", 2)
    assert "thesis.docx" in entry.message
    assert (tmp_path / "out" / "coin" / "thesis.docx").read_text() == "x"


def test_what_may_not_be_replaced_is_seen_before_the_work(capture, done, monkeypatch):
    (done / "coin" / "notes.txt").write_text("x")
    monkeypatch.setattr("rakelight.batch.one.refine_source", raising(AssertionError("work")))
    entry = do(capture, done, recipe({"max_iterations": "2"}), overwrite=True)
    assert (entry.state, entry.exit_code) == ("failed", 2)
    assert "notes.txt" in entry.message


def test_failures_are_answers(tmp_path, capture, monkeypatch):
    entry = do(tmp_path / "none", tmp_path / "out")
    assert (entry.state, entry.exit_code) == ("failed", 2)
    assert "no such folder or file" in entry.message
    (capture / "rgb" / "000.png").write_bytes(b"")
    entry = do(capture, tmp_path / "out")
    assert (entry.state, entry.exit_code) == ("failed", 2)
    assert "000.png" in entry.message
    for error, code, words in [
        (MemoryError(), 3, "not enough memory"),
        (OSError(5, "Input/output error", "x.png"), 3, "x.png: the system refused it"),
        (RuntimeError("can't start new thread"), 3, "the system starts no more threads"),
        (bug_beside_an_import(), 1, "a bug in rakelight: ZeroDivisionError"),
        (ImportError("libx.so: cannot open", name="cv2"), 3, "a library cannot be loaded"),
        (ZeroDivisionError("x"), 1, "a bug in rakelight: ZeroDivisionError: x"),
    ]:
        monkeypatch.setattr("rakelight.batch.one.content_checksum", raising(error))
        entry = do(capture, tmp_path / "out")
        assert (entry.state, entry.exit_code) == ("failed", code)
        assert words in entry.message


def bug_beside_an_import():
    try:
        try:
            raise ImportError("optional", name="cupy")
        except ImportError:
            1 / 0  # noqa: B018
    except ZeroDivisionError as error:
        return error


def raising(error):
    def raises(*_):
        raise error

    return raises


def test_a_url_is_refined_and_named(capture, tmp_path):
    entry = do(capture.as_uri(), tmp_path / "out")
    assert (entry.state, entry.message) == ("done", "")
    assert read_summary(tmp_path / "out" / "coin").source == capture.as_uri()
    (capture / "rgb" / "000.png").write_bytes(b"")
    failed = do(capture.as_uri(), tmp_path / "other")
    assert failed.message.startswith(f"{capture.as_uri()}/rgb/000.png: ")


def test_options_that_do_not_exist_are_refused_before(monkeypatch):
    from rakelight.errors import InputError

    with pytest.raises(InputError, match="no such option"):
        recipe({"depth_wait": "3"}).check()
    with pytest.raises(InputError):
        Recipe(method="none").check()
    recipe().check()


def test_a_line_of_a_list_that_leads_nowhere_is_named(tmp_path):
    job = Job(f"{tmp_path}/cion", "cion", "all.txt, line 3")
    entry = run_one(job, str(tmp_path / "out"), recipe(), False, program_version())
    assert entry.message.startswith(f"all.txt, line 3: {tmp_path}/cion: no such folder or file")
