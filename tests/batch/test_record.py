"""batch.json, and which folders may be a batch's."""

import pytest

from rakelight.batch.record import Entry, delete_remains, opened, read_record, write_record
from rakelight.errors import InputError, OutputExistsError

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
