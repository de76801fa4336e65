"""Damaged recordings are read, or refused in one line."""

import sqlite3
from collections import Counter
from contextlib import suppress
from random import Random

import numpy as np
import pytest

from rakelight import load_capture
from rakelight.errors import CaptureError
from rakelight.model import RigidTransform
from tests.capture.readers.realsense_files import Take, jpegs, some_color, write_bag, write_db3
from tests.capture.readers.ros_files import Messages, node, write_node
from tests.faults.fuzz import tried
from tests.faults.mutations import mutated

BESIDE = RigidTransform(np.eye(3), np.array([0.015, 0.0, 0.0]))
YUYV = Take(depth_to_color=BESIDE, color=[each // 2 for each in some_color(4, 2)], format="yuyv")
MJPEG = Take(depth_to_color=BESIDE, color=jpegs(some_color()), format="mjpeg")
PLAIN = Take(depth_to_color=BESIDE, compressed=False)
FILES = {
    "mjpeg.db3": lambda path: write_db3(path, MJPEG),
    "yuyv.db3": lambda path: write_db3(path, YUYV),
    "plain.db3": lambda path: write_db3(path, PLAIN),
    "png.db3": lambda path: write_db3(path, Take(depth_to_color=BESIDE)),
    "plain.bag": lambda path: write_bag(path, PLAIN, ""),
    "lz4.bag": lambda path: write_bag(path, PLAIN, "lz4"),
    "bz2.bag": lambda path: write_bag(path, PLAIN, "bz2"),
    "node.bag": lambda path: write_node(path, node(Messages(True), place=BESIDE)),
    "node.mcap": lambda path: write_node(path, node(Messages(False), place=BESIDE)),
    "node.db3": lambda path: write_node(path, node(Messages(False), place=BESIDE)),
}


@pytest.mark.parametrize("name", FILES)
def test_every_damaged_recording_is_read_or_refused(tmp_path, name):
    path = tmp_path / name
    FILES[name](path)
    sound, random = path.read_bytes(), Random(name)
    assert tried(lambda: load_capture(path)) == "read"
    outcomes = Counter()
    for _ in range(30):
        path.write_bytes(mutated(random, sound, sound))
        outcomes[tried(lambda: load_capture(path))] += 1
    assert set(outcomes) == {"read", "refused"}
    assert list(tmp_path.iterdir()) == [path]


def test_messages_of_any_bytes(tmp_path):
    """Behind the database's own checks."""
    path, random = tmp_path / "rec.db3", Random(5)
    write_db3(path, PLAIN)
    sound = path.read_bytes()
    outcomes = Counter()
    for _ in range(60):
        path.write_bytes(sound)
        with sqlite3.connect(path) as database:
            rows = database.execute("SELECT rowid, data FROM messages").fetchall()
            row, data = random.choice(rows)
            change = "UPDATE messages SET data = ? WHERE rowid = ?"
            database.execute(change, (mutated(random, data, data), row))
        database.close()
        outcomes[tried(lambda: load_capture(path))] += 1
    assert set(outcomes) == {"read", "refused"}


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("UPDATE messages SET timestamp = 'noon'", "this recording is damaged"),
        ("UPDATE messages SET data = 7", "is damaged"),
        ("UPDATE messages SET topic_id = 1", "no pictures of colour"),
        ("UPDATE topics SET type = 'std_msgs/msg/UInt32'", "holds something else"),
        ("DELETE FROM topics", "no pictures of colour .* .seen no messages"),
        ("ALTER TABLE messages RENAME COLUMN data TO bytes", "is damaged"),
    ],
)
def test_tables_of_something_else(tmp_path, change, what):
    path = tmp_path / "rec.db3"
    write_db3(path, PLAIN)
    with sqlite3.connect(path) as database:
        database.execute(change)
    database.close()
    with pytest.raises(CaptureError, match=what):
        load_capture(path)


@pytest.mark.parametrize("name", ["png.db3", "lz4.bag"])
def test_a_recording_that_was_cut_off(tmp_path, name):
    FILES[name](tmp_path / name)
    sound = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(sound[: len(sound) // 2])
    with pytest.raises(CaptureError, match=r"damaged|is not read"):
        load_capture(tmp_path / name)


def test_a_schema_with_bytes_that_are_no_text_is_damaged(tmp_path):
    """SQLite's own message then has them, too."""
    path = tmp_path / "rec.db3"
    write_db3(path, PLAIN)
    data = path.read_bytes()
    schema = data.find(b"CREATE TABLE messages")
    for at in range(schema - 20, schema):
        path.write_bytes(data[:at] + b"\xff" + data[at + 1 :])
        with suppress(CaptureError):
            load_capture(path)
            continue
        with pytest.raises(CaptureError, match="this recording is damaged"):
            load_capture(path)


def test_a_computed_column_is_not_evaluated(tmp_path):
    """An untrusted schema could make the database compute anything when it is read."""
    path = tmp_path / "rec.db3"
    write_db3(path, PLAIN)
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE other AS SELECT * FROM messages")
        database.execute("DROP TABLE messages")
        database.execute(
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
            "kept BLOB, data BLOB GENERATED ALWAYS AS (zeroblob(999999999)) VIRTUAL)"
        )
        database.execute("INSERT INTO messages (id, topic_id, timestamp, kept) SELECT * FROM other")
    database.close()
    with pytest.raises(CaptureError, match="is damaged"):
        load_capture(path)
