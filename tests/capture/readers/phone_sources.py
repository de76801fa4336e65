"""A small capture of a moving lamp, written as phones and recorders write it."""

from __future__ import annotations

import io
import json
import zipfile
from fractions import Fraction
from functools import cache

import av
import lzfse
import numpy as np
from av.video.reformatter import ColorRange
from PIL import Image

from rakelight.model import Camera, RigidTransform
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

WIDTH, HEIGHT = 120, 90
DEPTH_WIDTH, DEPTH_HEIGHT = 16, 12
"""The colour frames have 7.5 pixels per pixel of depth, as 1920x1440 over 256x192."""
CAMERA = make_shape("vase").camera.resized(WIDTH, HEIGHT)
FPS = 30.0
BT709, BT601, LIMITED, FULL = 1, 5, 1, 2


@cache
def scene(photographs=12, noise=0.004):
    """(capture, truth): 8-bit sRGB photographs, depth of 16x12 at the colour camera's place."""
    options = SceneOptions(
        camera=CAMERA,
        photographs=photographs,
        bits=8,
        encoding="srgb",
        image_noise=noise,
        depth_factor=WIDTH / DEPTH_WIDTH,
        depth_to_color=RigidTransform(np.eye(3), np.zeros(3)),
        depth_frames=photographs,
    )
    return render_scene(make_shape("vase"), make_albedo("simple"), options)


def frames(count=12):
    """(N, 90, 120, 3) uint8."""
    return scene(count)[0].photographs


def depth_maps(count=12):
    """(N, 12, 16) float32 metres; NaN in one corner."""
    depth_m = scene(count)[0].depth_m.copy()
    depth_m[:, :1, :2] = np.nan
    return depth_m


def doubts(depth_m):
    """(N, h, w) uint8 confidence of depth maps: 0 in another corner, and where there is none."""
    sure = np.where(np.isnan(depth_m), 0, 2).astype(np.uint8)
    sure[:, -1:, -2:] = 0
    return sure


def expected(depth_m, scale=None):
    """What is read of depth maps that were stored with their doubts."""
    stored = depth_m if scale is None else np.rint(depth_m * scale) / scale
    return np.where(doubts(depth_m) == 0, np.nan, stored).astype(np.float32)


def jpeg(image, **options):
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=97, subsampling=0, **options)
    return file.getvalue()


def png(image):
    file = io.BytesIO()
    Image.fromarray(image).save(file, "PNG")
    return file.getvalue()


def metadata(count=12, camera=CAMERA, **changes):
    """The JSON of an .r3d."""
    facts = {
        "K": [camera.fx, 0, 0, 0, camera.fy, 0, camera.cx, camera.cy, 1],
        "w": camera.width,
        "h": camera.height,
        "dw": DEPTH_WIDTH,
        "dh": DEPTH_HEIGHT,
        "fps": 30,
        "poses": [[0, 0, 0, 1, 0.1, 0.2, 0.3]] * count,
        "initPose": [0, 0, 0, 1, 0, 0, 0],
        "frameTimestamps": [100 + i / FPS for i in range(count)],
    }
    facts.update(changes)
    return {key: value for key, value in facts.items() if value is not None}


def r3d_members(facts=None, images=None, depth_m=None, exif=None):
    """The members of an .r3d by name."""
    images = frames() if images is None else images
    depth_m = depth_maps() if depth_m is None else depth_m
    members = {"metadata": json.dumps(facts or metadata(len(images))).encode(), "icon": b"JPEG"}
    options = {} if exif is None else {"exif": exif}
    maps = zip(images, depth_m, doubts(depth_m), strict=True)
    for i, (image, metres, sure) in enumerate(maps):
        members[f"rgbd/{i}.jpg"] = jpeg(image, **options)
        members[f"rgbd/{i}.depth"] = lzfse.compress(np.nan_to_num(metres).astype("<f4").tobytes())
        members[f"rgbd/{i}.conf"] = lzfse.compress(sure.tobytes())
    return members


def write_r3d(path, members=None):
    """A recording of Record3D; returns its path."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (members or r3d_members()).items():
            archive.writestr(zipfile.ZipInfo(name), data)
    return path


def write_video(
    path, images, *, codec="libx264", matrix=BT709, limits=LIMITED, transfer=1, primaries=1,
    pixels="yuv420p", crf=4, key_every=250, fps=30, first=0,
):  # fmt: skip
    """An mp4 of (N, H, W, 3) images; an edit list hides those before the time 0.

    first : number of the first frame's time
    """
    muxer = {"avoid_negative_ts": "disabled"} if first else {}
    with av.open(str(path), "w", format="mp4", options=muxer) as container:
        # x264's macroblock tree reads memory that it has not written, where frames are tiny.
        options = {"crf": str(crf), "mbtree": "0"}
        stream = container.add_stream(codec, rate=fps, options=options)
        if codec == "libx265":
            stream.options = {"x265-params": f"log-level=none:crf={crf}:pools=1"}
        stream.width, stream.height, stream.pix_fmt = images[0].shape[1], images[0].shape[0], pixels
        context = stream.codec_context
        if first:
            context.max_b_frames = 0
        context.gop_size = key_every
        context.colorspace, context.color_range = matrix, limits
        context.color_trc, context.color_primaries = transfer, primaries
        for i, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
                format=pixels,
                dst_colorspace=matrix,
                src_color_range=ColorRange.JPEG,
                dst_color_range=limits,
            )
            frame.pts, frame.time_base = first + i, Fraction(1, fps)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def odometry(count=12, start=0, place=lambda i: (0.1, 0.2, 0.3), **columns):
    """The text of odometry.csv; newer recordings have further columns."""
    lines = [", ".join(["timestamp, frame, x, y, z, qx, qy, qz, qw", *columns])]
    for i in range(count):
        fields = [f"{55.5 + i / FPS}", f"{start + i:06d}", *map(str, place(i)), "0", "0", "0", "1"]
        lines.append(", ".join([*fields, *map(str, columns.values())]))
    return "\n".join(lines)


def matrix_text(camera=CAMERA):
    return f"{camera.fx}, 0.0, {camera.cx}\n0.0, {camera.fy}, {camera.cy}\n0.0, 0.0, 1.0"


def write_stray(path, images=None, depth_m=None, *, text=None, start=0, camera=CAMERA, **video):
    """A folder of Stray Scanner; returns it."""
    images = frames() if images is None else images
    depth_m = depth_maps() if depth_m is None else depth_m
    for name in ("depth", "confidence"):
        (path / name).mkdir(parents=True)
    write_video(path / "rgb.mp4", images, **video)
    for i, (metres, sure) in enumerate(zip(depth_m, doubts(depth_m), strict=True), start):
        values = np.rint(np.nan_to_num(metres) * 1000).astype(np.uint16)
        (path / f"depth/{i:06d}.png").write_bytes(png(values))
        (path / f"confidence/{i:06d}.png").write_bytes(png(sure))
    (path / "camera_matrix.csv").write_text(matrix_text(camera))
    (path / "odometry.csv").write_text(text or odometry(len(images), start))
    (path / "imu.csv").write_text("timestamp, a_x, a_y, a_z, alpha_x, alpha_y, alpha_z\n")
    return path


def grown(depth_m):
    """Depth maps (N, h, w) at the colour frames' size, of recorders that align them."""
    rows = np.arange(HEIGHT) * DEPTH_HEIGHT // HEIGHT
    columns = np.arange(WIDTH) * DEPTH_WIDTH // WIDTH
    return depth_m[:, rows][:, :, columns]


def write_open3d(
    path, images=None, depth_m=None, camera=CAMERA, by_rows=False, suffix="png", per_metre=1000,
    **facts,
):  # fmt: skip
    """A folder of Open3D's recorders; returns it."""
    images = frames() if images is None else images
    depth_m = grown(depth_maps()) if depth_m is None else depth_m
    for name in ("color", "depth"):
        (path / name).mkdir(parents=True)
    for i, (image, metres) in enumerate(zip(images, depth_m, strict=True)):
        data = png(image) if suffix == "png" else jpeg(image)
        (path / f"color/{i:06d}.{suffix}").write_bytes(data)
        values = np.rint(np.nan_to_num(metres) * per_metre).astype(np.uint16)
        (path / f"depth/{i:06d}.png").write_bytes(png(values))
    matrix = camera.matrix if by_rows else camera.matrix.T
    facts |= {"width": camera.width, "height": camera.height}
    facts["intrinsic_matrix"] = matrix.ravel().tolist()
    (path / "camera_intrinsic.json").write_text(json.dumps(facts, indent=4))
    return path


def write_tum(path, images=None, depth_m=None, intrinsics=None, per_metre=5000):
    """A folder as of the TUM benchmark; depth is taken 10 ms after colour.  Returns it."""
    images = frames() if images is None else images
    depth_m = grown(depth_maps()) if depth_m is None else depth_m
    for name in ("rgb", "depth"):
        (path / name).mkdir(parents=True)
    lists = {"rgb": ["# color images", "# timestamp filename"], "depth": ["# depth maps"]}
    for i, (image, metres) in enumerate(zip(images, depth_m, strict=True)):
        values = np.rint(np.nan_to_num(metres) * per_metre).astype(np.uint16)
        for name, pixels, later in (("rgb", image, 0.0), ("depth", values, 0.01)):
            time = f"{1305031102.175304 + i / FPS + later:.6f}"
            (path / name / f"{time}.png").write_bytes(png(pixels))
            lists[name].append(f"{time} {name}/{time}.png")
    for name, lines in lists.items():
        (path / f"{name}.txt").write_text("\n".join(lines) + "\n")
    if intrinsics is None:
        intrinsics = f"{CAMERA.fx} {CAMERA.fy} {CAMERA.cx} {CAMERA.cy}\n"
    if intrinsics:
        (path / "intrinsics.txt").write_text(intrinsics)
    return path


def pose_rows(place=(0.1, 0.2, 0.3)):
    """The first twelve numbers of a camera's place, rows first: it is turned by 90 degrees."""
    x, y, z = place
    return [0, -1, 0, x, 1, 0, 0, y, 0, 0, 1, z]


def write_scanner_app(
    path, images=None, depth_m=None, *, place=lambda i: (0.1, 0.2, 0.3), camera=CAMERA, every=1
):
    """A folder of 3D Scanner App; returns it.  every : of how many frames one has a photograph"""
    images = frames() if images is None else images
    depth_m = depth_maps() if depth_m is None else depth_m
    path.mkdir(parents=True)
    for i, (image, metres, sure) in enumerate(zip(images, depth_m, doubts(depth_m), strict=True)):
        if i % every == 0:
            (path / f"frame_{i:05d}.jpg").write_bytes(jpeg(image))
            (path / f"thumb_{i:05d}.jpg").write_bytes(jpeg(image[::2, ::2]))
        values = np.rint(np.nan_to_num(metres) * 1000).astype(np.uint16)
        (path / f"depth_{i:05d}.png").write_bytes(png(values))
        (path / f"conf_{i:05d}.png").write_bytes(png(sure))
        facts = {
            "exposureDuration": 0.016,
            "cameraPoseARFrame": [*pose_rows(place(i)), 0, 0, 0, 0.99999988],
            "motionQuality": 1,
            "time": 402896.97 + i / FPS,
            "frame_index": i,
            "intrinsics": camera.matrix.ravel().tolist(),
        }
        (path / f"frame_{i:05d}.json").write_text(json.dumps(facts, indent=2))
    (path / "info.json").write_text('{"title": "a scan"}')
    return path


def write_polycam(path, images=None, depth_m=None, *, place=lambda i: (0.1, 0.2, 0.3), half=False):
    """A folder of Polycam's raw data; returns it.  half : the cameras are of half the size"""
    images = frames() if images is None else images
    depth_m = depth_maps() if depth_m is None else depth_m
    height, width = images.shape[1:3]
    camera = CAMERA.resized(width, height)
    camera = camera.resized(width // 2, height // 2) if half else camera
    root = path / "keyframes"
    for name in ("images", "depth", "cameras", "confidence", "corrected_cameras"):
        (root / name).mkdir(parents=True)
    for i, (image, metres, sure) in enumerate(zip(images, depth_m, doubts(depth_m), strict=True)):
        name = f"{293814600474 + 33000 * i}"
        (root / f"images/{name}.jpg").write_bytes(jpeg(image))
        values = np.rint(np.nan_to_num(metres) * 1000).astype(np.uint16)
        (root / f"depth/{name}.png").write_bytes(png(values))
        (root / f"confidence/{name}.png").write_bytes(png(np.array([0, 54, 255], np.uint8)[sure]))
        facts = {key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")}
        facts |= {f"t_{at // 4}{at % 4}": each for at, each in enumerate(pose_rows(place(i)))}
        facts |= {"timestamp": int(name), "blur_score": 105.5}
        (root / f"cameras/{name}.json").write_text(json.dumps(facts))
        (root / f"corrected_cameras/{name}.json").write_text(json.dumps({**facts, "fx": 1}))
    (path / "mesh_info.json").write_text("{}")
    return path


def portrait(camera: Camera) -> Camera:
    """The camera of images that were turned a quarter to the left."""
    return Camera(
        camera.height, camera.width, camera.fy, camera.fx, camera.cy, camera.width - 1 - camera.cx
    )
