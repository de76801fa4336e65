"""batch.json, and which folders may be a batch's."""

import pytest

from rakelight.batch.record import Entry, delete_remains, opened, read_record, write_record
from rakelight.batch.run import _begun
from rakelight.errors import InputError, OutputExistsError
from rakelight.recipe import Recipe

ENTRY = Entry(source="/a/coin", name="coin", state="failed", message="no depth", exit_code=2)
REMAINS = ".batch.json.rakelight-01234567.partial"


@pytest.fixture
def out(tmp_path):
    (tmp_path / "out").mkdir()
    write_record(tmp_path / "out", {"scale": "auto"}, [ENTRY])
    return tmp_path / "out"


def test_a_record_comes_back(out):
    record = read_record(out)
    assert record.captures == [ENTRY]
    assert record.options == {"scale": "auto"}
    assert opened(out) == record
    assert [path.name for path in out.iterdir()] == ["batch.json"]


def test_what_is_new_or_empty_may_be_used(tmp_path):
    assert opened(tmp_path / "none") is None
    (tmp_path / REMAINS).touch()
    assert opened(tmp_path) is None
    delete_remains(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[" * 100_000, b'{"schema": "other/1"}', b"1" * 5000]
)
def test_what_is_not_ours_is_refused(out, content):
    (out / "batch.json").write_bytes(content)
    with pytest.raises(InputError, match=r"batch.json: "):
        read_record(out)
    with pytest.raises(OutputExistsError, match=r"no batch wrote it \(seen batch.json"):
        opened(out)


def test_another_version_of_the_record_is_refused(out):
    text = (out / "batch.json").read_text().replace("rakelight-batch/1", "rakelight-batch/2")
    (out / "batch.json").write_text(text)
    with pytest.raises(InputError, match="another version"):
        read_record(out)


def test_somebody_elses_folder_and_file_are_refused(tmp_path):
    (tmp_path / "thesis.docx").touch()
    with pytest.raises(OutputExistsError, match=r"seen thesis\.docx"):
        opened(tmp_path)
    with pytest.raises(OutputExistsError, match="a file stands"):
        opened(tmp_path / "thesis.docx")


def test_what_an_earlier_run_did_is_not_of_this_one(tmp_path):
    done = Entry(source="a", name="a", state="done", computed=True, wall_s=2.0, cpu_s=3.0)
    write_record(tmp_path, {}, [done, Entry(source="b", name="b")])
    others = _begun(tmp_path, Recipe(), {"c": Entry(source="c", name="c")})
    assert others == [Entry(source="a", name="a", state="done")]
    assert [each.name for each in opened(tmp_path).captures] == ["c", "a"]
