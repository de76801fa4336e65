"""Recordings of ROS: the SQLite and MCAP files of ROS 2 (.db3, .mcap) and the bags of ROS 1 (.bag).

All are an index of messages by topic and time.  Only the index is read when one is opened, and of
the messages those that are asked for.  Nothing in a file is trusted: what an SQLite file may make
the database do is cut down to reading two tables, and every size is held against the file's.
"""

from __future__ import annotations

import os
import sqlite3
import stat
import struct
from bz2 import BZ2Decompressor
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from io import BufferedReader, FileIO
from itertools import islice
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from rakelight.errors import CaptureError, parsing
from rakelight.extras import needs
from rakelight.files import clear_errors
from rakelight.model import Array

SQLITE_MAGIC = b"SQLite format 3\0"
BAG_MAGIC = b"#ROSBAG V2.0\n"
MCAP_MAGIC = b"\x89MCAP0\r\n"
TF = "tf2_msgs/msg/TFMessage"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
# Bytes of the largest message or block of messages.  A frame of 4096 x 3072 RGBA has 50 MB, a
# block of librealsense's bags one message or 0.8 MB.
LONGEST = 1 << 28
# Bytes that a row takes at least in an SQLite file: its place, its number, three short columns.
_SHORTEST_ROW = 8

_BROKEN = "this recording is damaged"
AGAIN = "copy it again from where it was recorded, or record it again"


@dataclass(frozen=True)
class Topic:
    """The messages of one name.

    kind : their type, as ROS 2 writes it, such as "sensor_msgs/msg/Image"
    times_ns : (N,) int64 when each was recorded, rising
    read : the bytes of message i
    """

    kind: str
    times_ns: Array
    read: Callable[[int], bytes]


@dataclass(frozen=True)
class Bag:
    """An open recording: topics that have messages, by name.

    old : whether it is one of ROS 1
    """

    source: str
    topics: Mapping[str, Topic]
    old: bool

    def message(self, name: str, number: int, kinds: tuple[str, ...]) -> Any:
        """Message `number` of a topic, its fields as attributes.

        Raises CaptureError where there is none, it is of none of the `kinds`, or damaged.
        """
        topic = self.topics.get(name)
        if topic is None or number >= len(topic.times_ns):
            raise CaptureError(
                "a part is missing",
                source=self.source,
                needed=name,
                remedy=AGAIN,
            )
        if topic.kind not in kinds:
            raise CaptureError(
                f"{name} holds something else",
                source=self.source,
                seen=topic.kind,
                needed=" or ".join(kinds),
                remedy=AGAIN,
            )
        with parsing(self.source, f"{name} is damaged", CaptureError):
            store = _typestore(self.old)
            data = topic.read(number)
            if self.old:
                return store.deserialize_ros1(data, topic.kind)
            # Of messages that `ros2 bag record` packs singly; others begin with a zero.
            if data.startswith(_ZSTD_MAGIC):
                data = unpacked_zstd(data, LONGEST, fewer=True)
            return store.deserialize_cdr(data, topic.kind)


def is_bag(path: Path) -> bool:
    """Whether a file is a recording of ROS, by its first bytes and the tables in it."""
    if not stat.S_ISREG(path.stat().st_mode):
        return False
    with path.open("rb") as file:
        first = file.read(len(SQLITE_MAGIC))
    if first != SQLITE_MAGIC:
        return first.startswith((BAG_MAGIC, MCAP_MAGIC))
    try:
        with closing(_connected(path)) as database:
            return _has_tables(database)
    except (sqlite3.Error, UnicodeDecodeError):  # cut short: `opened` says so
        return path.suffix.lower() == ".db3"


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """A file that `is_bag` accepts; what is read of it is read before it is closed again.

    Raises CaptureError where it is damaged, MissingExtraError where rosbags is not installed.
    """
    source = str(path)
    with clear_errors(source, "cannot be read"), path.open("rb") as file:
        first = file.read(len(BAG_MAGIC))
    needs("rosbags", "recordings", source)
    kind = _bag if first == BAG_MAGIC else _mcap if first.startswith(MCAP_MAGIC) else _database
    with kind(path, source) as bag:
        yield bag


@cache
def _typestore(old: bool) -> Any:
    """How messages are laid out: as ROS has it, whatever the file says."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_HUMBLE)
    if old:  # rosbags has it for ROS 2 alone
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


@contextmanager
def _database(path: Path, source: str) -> Iterator[Bag]:
    with parsing(source, _BROKEN, CaptureError):
        connected = _connected(path)
    with closing(connected) as database:
        with parsing(source, _BROKEN, CaptureError):
            topics = _topics(database, path.stat().st_size // _SHORTEST_ROW)
        yield Bag(source, topics, old=False)


def _topics(database: sqlite3.Connection, most: int) -> dict[str, Topic]:
    """The topics that have messages; raises ValueError where a table has more than `most` rows.

    A damaged table may lead to the same rows again and again.
    """

    def rows_of(statement: str) -> Iterator[tuple[Any, ...]]:
        for count, row in enumerate(database.execute(statement)):
            if count == most:
                raise ValueError(f"more than {most} rows in a file of this size")
            yield row

    named = list(rows_of("SELECT id, name, type FROM topics"))
    kind = np.dtype([("row", np.int64), ("topic", np.int64), ("time_ns", np.int64)])
    # The pictures themselves stay unread: they lie on pages of their own.
    rows = np.fromiter(rows_of("SELECT rowid, topic_id, timestamp FROM messages"), kind)
    rows = rows[np.lexsort((rows["row"], rows["time_ns"], rows["topic"]))]
    topics = {}
    for number, name, of_type in named:
        first = np.searchsorted(rows["topic"], number, "left")
        end = np.searchsorted(rows["topic"], number, "right")
        if end > first:
            own = rows[first:end]
            topics[str(name)] = Topic(str(of_type), own["time_ns"], _row_reader(database, own))
    return topics


def _row_reader(database: sqlite3.Connection, rows: Array) -> Callable[[int], bytes]:
    def read(number: int) -> bytes:
        row = int(rows["row"][number])
        (data,) = database.execute("SELECT data FROM messages WHERE rowid = ?", (row,)).fetchone()
        return bytes(memoryview(data))

    return read


def _connected(path: Path) -> sqlite3.Connection:
    """Open for reading only; `immutable` keeps SQLite from making files beside it."""
    uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
    database = sqlite3.connect(uri, uri=True)
    try:
        longest = min(LONGEST, path.stat().st_size)
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, longest)
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA cell_size_check = ON")
        database.set_authorizer(_reading_only)
    except BaseException:
        database.close()
        raise
    return database


def _reading_only(action: int, table: str | None, *_: object) -> int:
    """Whether a statement may do this; functions, views' tables and pragmas may not be used."""
    tables = ("topics", "messages", "sqlite_master")
    reading = action == sqlite3.SQLITE_READ and table in tables
    allowed = reading or action == sqlite3.SQLITE_SELECT
    return sqlite3.SQLITE_OK if allowed else sqlite3.SQLITE_DENY


def _has_tables(database: sqlite3.Connection) -> bool:
    """Whether topics and messages are stored tables, neither views nor virtual."""
    sought = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
    return {"topics", "messages"} <= {name for (name,) in database.execute(sought)}


@contextmanager
def _bag(path: Path, source: str) -> Iterator[Bag]:
    from rosbags import rosbag1

    with parsing(source, _BROKEN, CaptureError), clear_errors(source, "cannot be read"):
        reader = rosbag1.Reader(_Bounded(path))  # type: ignore[arg-type]
        try:
            reader.open()
        except rosbag1.ReaderError as error:
            remedy = "`rosbag reindex` repairs it" if "not indexed" in str(error) else AGAIN
            raise CaptureError(_BROKEN, source=source, seen=str(error), remedy=remedy) from error
    try:
        with parsing(source, _BROKEN, CaptureError):
            for position, chunk in reader.chunks.items():
                library = (chunk.decompressor.__module__ or "").split(".")[0]
                limited = _LIMITED.get(library, chunk.decompressor)
                reader.chunks[position] = chunk._replace(decompressor=limited)
            topics = _bag_topics(reader)
        yield Bag(source, topics, old=True)
    finally:
        reader.close()


def _bag_topics(reader: Any) -> dict[str, Topic]:
    topics = {}
    for name in dict.fromkeys(connection.topic for connection in reader.connections):
        own = [connection for connection in reader.connections if connection.topic == name]
        times = [entry.time for connection in own for entry in reader.indexes[connection.id]]
        if times:
            times_ns = np.sort(np.array(times, np.int64))
            topics[name] = Topic(own[0].msgtype, times_ns, _bag_reader(reader, own, times_ns))
    return topics


def _bag_reader(reader: Any, connections: list[Any], times_ns: Array) -> Callable[[int], bytes]:
    def read(number: int) -> bytes:
        time_ns = int(times_ns[number])
        before = number - int(np.searchsorted(times_ns, time_ns))  # messages of the same time
        found = reader.messages(connections, start=time_ns, stop=time_ns + 1)
        return bytes(next(islice(found, before, None))[2])

    return read


@contextmanager
def _mcap(path: Path, source: str) -> Iterator[Bag]:
    from rosbags.rosbag2 import ReaderError
    from rosbags.rosbag2.storage_mcap import McapReader

    class Indexed(McapReader):
        """One that never unpacks the whole file to find what is in it."""

        def meta_scan(self) -> None:
            raise ReaderError("no index")

    with parsing(source, _BROKEN, CaptureError), clear_errors(source, "cannot be read"):
        reader = Indexed(_Bounded(path))  # type: ignore[arg-type]
        try:
            reader.open()
        except (OSError, MemoryError):
            raise
        except Exception as error:
            seen = str(error) if isinstance(error, ReaderError) else "its end is missing"
            remedy = f"`mcap recover {path.name}` makes a new one of it, or copy it again"
            raise CaptureError(_BROKEN, source=source, seen=seen, remedy=remedy) from error
    try:
        with parsing(source, _BROKEN, CaptureError):
            topics = _mcap_topics(reader, path.stat().st_size)
        yield Bag(source, topics, old=False)
    finally:
        reader.close()


def _mcap_topics(reader: Any, most: int) -> dict[str, Topic]:
    """The topics that have messages, by the chunks' own indices of at most so many bytes in all.

    Format: mcap.dev/spec, Message Index (7), Message (5) and Chunk (6).
    """
    found: dict[str, list[Array]] = {}
    channels = {each.id: each for each in reader.connections}
    for number, chunk in enumerate(reader.chunks):
        for channel, at in chunk.message_index_offsets.items():
            reader.bio.seek(at)
            kind, _, of_channel, size = struct.unpack("<BQHI", reader.bio.read(15))
            most -= size + 15
            if kind != 7 or of_channel != channel or most < 0:
                raise ValueError("a wrong index")
            rows = np.frombuffer(reader.bio.read(size), "<i8").reshape(-1, 2)
            rows = np.column_stack([rows, np.full(len(rows), number)])
            found.setdefault(channels[channel].topic, []).append(rows)
    kinds = {each.topic: each.msgtype for each in reader.connections}
    unpacked = lru_cache(maxsize=2)(partial(_chunk, reader))  # colour and depth take turns
    topics = {}
    for name, arrays in found.items():
        rows = np.concatenate(arrays)
        rows = rows[np.lexsort((rows[:, 1], rows[:, 2], rows[:, 0]))]
        if len(rows):
            topics[name] = Topic(kinds[name], rows[:, 0].copy(), _mcap_reader(unpacked, rows))
    return topics


def _mcap_reader(unpacked: Callable[[int], bytes], rows: Array) -> Callable[[int], bytes]:
    """rows : (N, 3) time, place in the chunk, and the chunk's number."""

    def read(number: int) -> bytes:
        _, at, of_chunk = rows[number].tolist()
        data = unpacked(of_chunk)
        kind, size = struct.unpack_from("<BQ", data, at)
        if at < 0 or kind != 5 or not 22 <= size <= len(data) - at - 9:
            raise ValueError("no message where the index says")
        return data[at + 9 + 22 : at + 9 + size]

    return read


def _chunk(reader: Any, number: int) -> bytes:
    """The messages of one chunk."""
    chunk = reader.chunks[number]
    reader.bio.seek(chunk.chunk_start_offset + 9)
    _, _, size, checksum, letters = struct.unpack("<QQQII", reader.bio.read(32))
    if size > LONGEST or letters > 4:
        raise ValueError(f"a block of {size} bytes")
    how = reader.bio.read(letters)
    (packed,) = struct.unpack("<Q", reader.bio.read(8))
    data = reader.bio.read(packed)
    if how:
        data = _lz4(data) if how == b"lz4" else unpacked_zstd(data, size)
    if len(data) != size or (checksum and crc32(data) != checksum):
        raise ValueError("a block that is not what it was")
    return bytes(data)


class _Bounded:
    """A path as rosbags opens it, whose file gives no more than there is of what is asked.

    A length of 4 GB in a damaged header would be allocated before the file turned out shorter.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def exists(self) -> bool:
        return self._path.exists()

    def open(self, _: str) -> BufferedReader:
        return _BoundedFile(FileIO(self._path))


class _BoundedFile(BufferedReader):
    def __init__(self, file: FileIO) -> None:
        super().__init__(file)
        self._size = os.fstat(file.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(self._size - self.tell(), 0)
        wanted = left if size is None or size < 0 else min(size, left)
        if wanted > LONGEST:
            raise ValueError(f"{wanted} bytes in one piece")
        return super().read(wanted)


def _bz2(data: bytes) -> bytes:
    return _whole(BZ2Decompressor(), data)


def _lz4(data: bytes) -> bytes:
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    return _whole(LZ4FrameDecompressor(), data)


def unpacked_zstd(data: bytes, size: int, fewer: bool = False) -> bytes:
    """`size` bytes packed by Zstandard; raises ValueError where they are more, or not to be fewer.

    fewer : whether they may be
    """
    try:
        from compression.zstd import ZstdDecompressor  # type: ignore[import-not-found]
    except ModuleNotFoundError:  # before Python 3.14
        from backports.zstd import ZstdDecompressor
    unpacked: bytes = ZstdDecompressor().decompress(data, max_length=size + 1)
    if len(unpacked) > size or (len(unpacked) < size and not fewer):
        raise ValueError(f"not {size} bytes when unpacked")
    return unpacked


def _whole(decompressor: Any, data: bytes) -> bytes:
    """All of it, at most LONGEST bytes."""
    unpacked: bytes = decompressor.decompress(data, max_length=LONGEST)
    if not decompressor.eof:
        raise ValueError("a block ends early or is too large")
    return unpacked


# In the place of rosbags' decompressors, by their library: those unpack without a limit.
_LIMITED: dict[str, Callable[[bytes], bytes]] = {"bz2": _bz2, "lz4": _lz4}
