"""Every kind of work that needs an optional library says which one where it is not installed."""

import sys

import pytest

from rakelight import load_capture
from rakelight.batch.cluster import require_dask
from rakelight.batch.remote import matching_urls
from rakelight.capture.readers import find_reader
from rakelight.cli.commands import run
from rakelight.errors import MissingExtraError
from rakelight.extras import needs
from rakelight.paper.plots import require_matplotlib
from tests.capture.photo_files import dng, exr, heic, mosaic_of
from tests.capture.readers.kinect_files import write_mkv
from tests.capture.readers.phone_sources import write_r3d, write_stray
from tests.capture.readers.realsense_files import Take, write_bag, write_db3
from tests.capture.readers.test_photographs import fill


def loose(folder, suffix):
    """Photographs and depth, the photographs in another format than PNG."""
    made = fill(folder)
    for i, pixels in enumerate(made.photographs):
        path = folder / f"img{9 + i}.png"
        path.unlink()
        path = path.with_suffix(suffix)
        if suffix == ".exr":
            exr(path, RGB=(pixels / 255).astype("f4"))
        else:
            path.write_bytes(heic(pixels) if suffix == ".heic" else dng(mosaic_of(pixels / 255)))
    return folder


def realsense(write, path):
    write(path, Take())
    return path


SOURCES = {
    "db3": ("rosbags", "recordings", lambda p: realsense(write_db3, p / "a.db3")),
    "bag": ("rosbags", "recordings", lambda p: realsense(write_bag, p / "a.bag")),
    "mkv": ("av", "recordings", lambda p: write_mkv(p / "a.mkv")),
    "r3d": ("lzfse", "recordings", lambda p: write_r3d(p / "a.r3d")),
    "stray": ("av", "recordings", lambda p: write_stray(p / "stray")),
    "heic": ("pillow_heif", "photos", lambda p: loose(p / "heic", ".heic")),
    "raw": ("rawpy", "photos", lambda p: loose(p / "raw", ".dng")),
    "exr": ("OpenEXR", "photos", lambda p: loose(p / "exr", ".exr")),
}


@pytest.mark.parametrize("kind", SOURCES)
def test_a_source_without_its_library(tmp_path, monkeypatch, capfd, kind):
    library, extra, make = SOURCES[kind]
    source, out = make(tmp_path), tmp_path / "out"
    monkeypatch.setitem(sys.modules, library, None)
    assert find_reader(source).extra == extra
    with pytest.raises(MissingExtraError, match="not installed") as caught:
        load_capture(source)
    capfd.readouterr()
    assert run(["import", str(source), "-o", str(out), "--quiet"]) == 3
    said = capfd.readouterr().err
    assert said == f"error: {caught.value}\n"
    assert said.startswith(f"error: {source}")
    assert f'needed {library}). Fix: pip install "rakelight[{extra}]"' in said
    assert not out.exists()


@pytest.mark.parametrize(
    ("library", "extra", "use"),
    [
        ("distributed", "batch", require_dask),
        ("fsspec", "batch", lambda: matching_urls("s3://bucket/*")),
        ("matplotlib", "paper", require_matplotlib),
    ],
)
def test_other_work_without_its_library(monkeypatch, library, extra, use):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=rf"needed {library}.*rakelight\[{extra}\]"):
        use()


def test_a_library_that_is_there_and_lacks_another_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "half_there.py").write_text("import no_such_library_either\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="no_such_library_either"):
        needs("half_there", "recordings", "rec.db3")
