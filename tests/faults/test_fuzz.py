"""A short run of `make fuzz`, and that it sees what it looks for."""

import sys
import textwrap
from contextlib import suppress

import pytest

from rakelight.capture.readers import find_reader, readers
from rakelight.errors import CaptureError, InputError, MachineError
from tests.faults import sound_files
from tests.faults.fuzz import Cases, fuzz, tried


def test_every_damaged_file_is_read_or_refused():
    """Five files of each kind, by one worker: each loads all readers first."""
    ran = fuzz(seed=1, cases=340, workers=1)
    assert [outcome.case for outcome in ran] == list(range(340))
    assert [outcome for outcome in ran if outcome.failed] == []
    kinds = {outcome.kind for outcome in ran}
    assert {outcome.kind for outcome in ran if outcome.what == "refused"} == kinds
    assert {outcome.kind for outcome in ran if outcome.what == "read"} == kinds


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """Those of seed 3; their sound files are on the disk."""
    return Cases(3, tmp_path_factory.mktemp("cases") / "files")


def test_every_reader_has_a_sound_source_to_damage(cases):
    """The damaged file, or a folder above it, is a source that the reader recognises."""
    found = set()
    for kind in cases.kinds:
        for place in (kind.path, *kind.path.parents[:2]):
            with suppress(CaptureError):
                found.add(find_reader(place).name)
    assert found == {reader.name for reader in readers()}


def test_a_case_is_the_same_file_each_time(cases, tmp_path, monkeypatch):
    again = Cases(3, tmp_path / "again")
    monkeypatch.setattr(sound_files, "make_kinds", lambda _: again.kinds)
    others = Cases(4, tmp_path / "others")
    numbers = range(200)
    assert [cases.file(case) for case in numbers] == [again.file(case) for case in numbers]
    assert [cases.file(case) for case in numbers] != [others.file(case) for case in numbers]
    damaged = [cases.file(case) != cases.sound[case % len(cases.kinds)] for case in numbers]
    # the first of each kind is not
    assert sum(damaged) > 0.95 * (len(numbers) - len(cases.kinds))


@pytest.mark.parametrize(
    ("error", "what"),
    [
        (InputError("no image"), "refused"),
        (MachineError("no memory"), "MachineError: no memory"),
        (ValueError("bad\tvalue"), "ValueError: bad value"),
        (InputError("a" * 9000, source="b" * 9000), "message"),
    ],
)
def test_what_comes_of_an_error(error, what):
    def read():
        raise error

    assert tried(read).startswith(what)


# A worker does this with one case; the others are read.
TROUBLE = {
    "os._exit(7)": "ended with 7",
    "os.kill(os.getpid(), 11)": "ended with -11",
    "faulthandler.dump_traceback_later(0.2, exit=True); time.sleep(60)": "Timeout",
    "print('words', file=sys.stderr)": "printed 'words' on stderr; read",
    "bytearray(3 << 30)": "MemoryError",
}


def test_a_worker_in_trouble_is_seen_and_followed_by_another(tmp_path):
    """Every third case is one; what makes the sound files is not loaded."""
    troubles = dict(zip(range(3, 18, 3), TROUBLE, strict=True))
    script = tmp_path / "worker.py"
    script.write_text(
        textwrap.dedent(f"""
        import faulthandler, os, sys, time
        from types import SimpleNamespace
        from tests.faults import fuzz

        def kinds(folder):
            folder.mkdir()
            (folder / "file").write_bytes(b"sound")
            return [SimpleNamespace(name="file", path=folder / "file", read=read)]

        def read():
            exec({troubles}.get(running, ""))

        class Cases(fuzz.Cases):
            def run(self, case):
                global running
                running = case
                return super().run(case)

        running = 0
        sys.modules["tests.faults.sound_files"] = SimpleNamespace(make_kinds=kinds)
        fuzz.Cases = Cases
        fuzz.work(*map(int, sys.argv[1:5]))
        """)
    )
    ran = fuzz(seed=1, cases=18, command=(sys.executable, str(script)))
    assert [outcome.case for outcome in ran] == list(range(18))
    assert [outcome.case for outcome in ran if outcome.failed] == list(troubles)
    for case, trouble in troubles.items():
        assert TROUBLE[trouble] in ran[case].what
