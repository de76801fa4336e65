"""A short run of `make fuzz`, and that it sees what it looks for."""

import sys
import textwrap
from contextlib import suppress

import pytest

from rakelight.capture.readers import find_reader, readers
from rakelight.errors import CaptureError, InputError, MachineError
from tests.faults.fuzz import Cases, fuzz, tried
from tests.faults.sound_files import make_kinds


def test_every_damaged_file_is_read_or_refused():
    ran = fuzz(seed=1, cases=500)
    assert [outcome.case for outcome in ran] == list(range(500))
    assert [outcome for outcome in ran if outcome.failed] == []
    kinds = {outcome.kind for outcome in ran}
    assert {outcome.kind for outcome in ran if outcome.what == "refused"} == kinds
    assert {outcome.kind for outcome in ran if outcome.what == "read"} == kinds


def test_every_reader_has_a_sound_source_to_damage(tmp_path):
    """The damaged file, or a folder above it, is a source that the reader recognises."""
    found = set()
    for kind in make_kinds(tmp_path / "files"):
        for place in (kind.path, *kind.path.parents[:2]):
            with suppress(CaptureError):
                found.add(find_reader(place).name)
    assert found == {reader.name for reader in readers()}


def test_a_case_is_the_same_file_each_time(tmp_path):
    first, second = Cases(3, tmp_path / "a"), Cases(3, tmp_path / "b")
    others = Cases(4, tmp_path / "c")
    cases = range(200)
    assert [first.file(case) for case in cases] == [second.file(case) for case in cases]
    assert [first.file(case) for case in cases] != [others.file(case) for case in cases]
    damaged = [first.file(case) != first.sound[case % len(first.kinds)] for case in cases]
    assert sum(damaged) > 0.95 * (len(cases) - len(first.kinds))  # the first of each kind is not


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


# Each worker does this with case 3; the others are read.
TROUBLE = {
    "os._exit(7)": "ended with 7",
    "os.kill(os.getpid(), 11)": "ended with -11",
    "faulthandler.dump_traceback_later(0.2, exit=True); time.sleep(60)": "Timeout",
    "print('words', file=sys.stderr)": "printed 'words' on stderr; read",
    "bytearray(3 << 30)": "MemoryError",
}


@pytest.mark.parametrize("trouble", TROUBLE)
def test_a_worker_in_trouble_is_seen_and_followed_by_another(tmp_path, trouble):
    script = tmp_path / "worker.py"
    script.write_text(
        textwrap.dedent(f"""
        import faulthandler, os, sys, time
        from tests.faults import fuzz, sound_files
        from tests.faults.sound_files import Kind

        def kinds(folder):
            folder.mkdir()
            (folder / "file").write_bytes(b"sound")
            return [Kind("file", folder / "file", read)]

        def read():
            if running == 3:
                {trouble}

        class Cases(fuzz.Cases):
            def run(self, case):
                global running
                running = case
                return super().run(case)

        running = 0
        sound_files.make_kinds = kinds
        fuzz.Cases = Cases
        fuzz.work(*map(int, sys.argv[1:5]))
        """)
    )
    ran = fuzz(seed=1, cases=8, command=(sys.executable, str(script)))
    assert [outcome.case for outcome in ran] == list(range(8))
    assert [outcome.case for outcome in ran if outcome.failed] == [3]
    assert TROUBLE[trouble] in ran[3].what
