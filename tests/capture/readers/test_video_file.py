"""Videos: colours by the matrix and range they name, every frame by its number, damage refused."""

import av
import cv2
import numpy as np
import pytest

from rakelight.capture.readers.video_file import video_stream
from rakelight.errors import CaptureError
from tests.capture.readers.phone_sources import BT601, BT709, FULL, LIMITED, write_video

COLOURS = np.array(
    [[200, 30, 40], [20, 180, 60], [40, 50, 210], [128, 128, 128],
     [250, 250, 250], [8, 8, 8], [230, 200, 40], [90, 60, 30]], np.uint8,
)  # fmt: skip


def patches():
    """(64, 128, 3) squares of 32 pixels, each of one colour."""
    return COLOURS.reshape(2, 4, 3).repeat(32, 0).repeat(32, 1)


def counted(count=300):
    """(N, 32, 64, 3) frames that hold their number in the brightness of 9 squares."""
    images = np.full((count, 32, 64, 3), 40, np.uint8)
    for i in range(count):
        for bit in range(9):
            images[i, 8 * (bit // 5) : 8 * (bit // 5) + 8, 8 * (bit % 5) : 8 * (bit % 5) + 8] = (
                220 if i >> bit & 1 else 20
            )
    return images


def number_of(image):
    """The number in a frame of `counted`."""
    bright = [image[8 * (b // 5) + 4, 8 * (b % 5) + 4].mean() > 120 for b in range(9)]
    return sum(1 << b for b, is_set in enumerate(bright) if is_set)


@pytest.mark.parametrize(
    ("codec", "matrix", "limits"),
    [
        ("libx264", BT709, LIMITED),
        ("libx264", BT709, FULL),
        ("libx264", BT601, LIMITED),
        ("libx265", BT709, LIMITED),
    ],
)
def test_colours_are_those_that_were_filmed(tmp_path, codec, matrix, limits):
    path = write_video(
        tmp_path / "a.mp4", [patches()] * 3, codec=codec, matrix=matrix, limits=limits
    )
    stream = video_stream(path, "a.mp4")
    ((_, image),) = stream.walk([1])
    seen = image[16::32, 16::32].reshape(-1, 3).astype(int)
    assert np.abs(seen - COLOURS).max() <= 3  # the other matrix or range: 10 and more
    assert stream.shape == (64, 128)


def textured():
    """(96, 128, 3) smooth random colours, none of which clips."""
    noise = np.random.default_rng(4).uniform(0, 1, (96, 128, 3))
    blurred = cv2.GaussianBlur(noise, (0, 0), 3)
    scaled = (blurred - blurred.min()) / (blurred.max() - blurred.min())
    return np.rint(80 + 80 * scaled).astype(np.uint8)


def exact_rgb(planes, height, width):
    """BT.709 of studio range as 8 bits have it, chroma from left of every other pixel."""
    y = planes[:height].astype(np.float32)
    chroma = planes[height:].reshape(2, height // 2, width // 2).astype(np.float32)
    columns, rows = np.meshgrid(np.arange(width) / 2, (np.arange(height) - 0.5) / 2)
    maps = columns.astype(np.float32), rows.astype(np.float32)
    blue, red = (cv2.remap(c, *maps, cv2.INTER_LINEAR, borderMode=1) / 224 for c in chroma - 128)
    y = (y - 16) / 219
    return 255 * np.stack(
        [y + 1.5748 * red, y - 0.18732 * blue - 0.46812 * red, y + 1.8556 * blue], -1
    )


def test_nothing_but_rounding_is_lost_in_the_conversion(tmp_path):
    """So what a video costs, its compression does."""
    path = write_video(tmp_path / "a.mp4", [textured()] * 2)
    with av.open(str(path)) as container:
        planes = next(container.decode(video=0)).to_ndarray()
    ((_, image),) = video_stream(path, "a.mp4").walk([0])
    off = image - exact_rgb(planes, 96, 128)
    assert np.abs(off).max() < 0.6
    assert np.abs(off.mean(axis=(0, 1))).max() < 0.03


def test_ten_bits_become_sixteen_and_lose_nothing(tmp_path):
    path = write_video(tmp_path / "a.mp4", [textured()] * 2, pixels="yuv420p10le")
    with av.open(str(path)) as container:
        frame = next(container.decode(video=0))
    sizes = ((96, 128), (48, 64), (48, 64))
    planes = [np.frombuffer(bytes(plane), "<u2") for plane in frame.planes]
    planes = [p.reshape(h, -1)[:, :w].ravel() for p, (h, w) in zip(planes, sizes, strict=True)]
    luma_and_chroma = np.concatenate(planes).reshape(-1, 128) / 4
    ((_, image),) = video_stream(path, "a.mp4").walk([0])
    assert image.dtype == np.uint16
    assert np.abs(image / 257 - exact_rgb(luma_and_chroma, 96, 128)).max() < 0.01


@pytest.mark.parametrize(("matrix", "limits"), [(BT601, LIMITED), (BT709, FULL), (BT601, FULL)])
def test_ten_bits_of_every_matrix_and_range(tmp_path, matrix, limits):
    path = write_video(
        tmp_path / "a.mp4", [patches()] * 2, pixels="yuv420p10le", matrix=matrix, limits=limits
    )
    ((_, image),) = video_stream(path, "a.mp4").walk([0])
    assert np.abs(image[16::32, 16::32].reshape(-1, 3) / 257 - COLOURS).max() <= 2


@pytest.mark.parametrize(("transfer", "primaries"), [(16, 1), (18, 1), (1, 9)])
def test_high_dynamic_range_is_refused(tmp_path, transfer, primaries):
    path = write_video(tmp_path / "a.mp4", [patches()] * 2, transfer=transfer, primaries=primaries)
    with pytest.raises(CaptureError, match=r"high dynamic range.*switch HDR video off"):
        list(video_stream(path, "a.mp4").walk([0]))


@pytest.mark.parametrize("key_every", [10, 300])
def test_every_frame_is_the_one_that_is_asked_for(tmp_path, key_every):
    path = write_video(tmp_path / "a.mp4", counted(), crf=12, key_every=key_every)
    stream = video_stream(path, "a.mp4")
    assert np.allclose(stream.times_s, np.arange(300) / 30, atol=1e-3)
    for wanted in (range(300), range(0, 300, 37), [299], [5, 6, 7, 150, 151, 298]):
        seen = [(number, number_of(image)) for number, image in stream.walk(list(wanted))]
        assert seen == [(number, number) for number in wanted]


def test_what_lies_between_far_frames_is_not_decoded(tmp_path):
    path = write_video(tmp_path / "a.mp4", counted(), crf=20, key_every=10)
    with av.open(str(path)) as container:
        packets = [(p.pts, p.pos, p.size) for p in container.demux(video=0) if p.size]
    first = packets[0][0]
    data = bytearray(path.read_bytes())
    for pts, pos, size in packets:
        if 10 < (pts - first) / (packets[-1][0] - first) * 299 < 280:
            data[pos : pos + size] = bytes(size)
    path.write_bytes(data)
    stream = video_stream(path, "a.mp4")
    assert [number_of(image) for _, image in stream.walk([3, 295])] == [3, 295]
    with pytest.raises(CaptureError, match="the video is damaged"):
        list(stream.walk(range(300)))


def test_how_the_phone_was_held_is_left_alone(tmp_path):
    """The stored frame is what belongs to the depth; players turn it by the file's matrix."""
    path = write_video(tmp_path / "a.mp4", [patches()] * 2)
    data = bytearray(path.read_bytes())
    identity = (65536).to_bytes(4, "big") + bytes(12) + (65536).to_bytes(4, "big") + bytes(12)
    at = data.index(b"tkhd") + 4 + 40  # version, times, identity of the track, ... : the matrix
    assert data[at : at + 32] == identity
    quarter = (0, 65536, 0, -65536 % 2**32, 0, 0, 64 << 16, 0)
    data[at : at + 32] = b"".join(number.to_bytes(4, "big") for number in quarter)
    path.write_bytes(data)
    with av.open(str(path)) as container:
        assert abs(next(container.decode(video=0)).rotation) == 90
    ((_, image),) = video_stream(path, "a.mp4").walk([0])
    assert image.shape == (64, 128, 3)


@pytest.mark.parametrize(
    "data", [b"", b"\0" * 100, b"#EXTM3U\n/etc/passwd\n", b"\0\0\0\x18ftypmp42"]
)
def test_what_is_no_video_is_refused(tmp_path, data):
    path = tmp_path / "a.mp4"
    path.write_bytes(data)
    with pytest.raises(CaptureError, match="the video is damaged"):
        video_stream(path, "a.mp4")
