"""Who may import whom (docs: CONTRIBUTING.md), and what importing costs."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import rakelight

PACKAGE = Path(rakelight.__file__).resolve().parent
SOURCES = sorted(PACKAGE.rglob("*.py"))

# A room may import from rooms further up, and from itself.
LAYERS = (
    ("errors",),
    ("memory", "extras"),
    ("model", "files", "jit"),
    ("folders", "scratch"),
    ("geometry",),
    ("solve",),
    ("photometry",),
    ("prepare",),
    ("capture",),
    ("check",),
    ("methods",),
    ("pipeline",),
    ("checkup",),
    ("synthetic", "metrics", "pictures"),
    ("export",),
    ("report", "paper"),
    ("recipe",),
    ("batch",),
    ("cli",),
    ("__main__",),
)
HEIGHT = {room: height for height, rooms in enumerate(LAYERS) for room in rooms}

ALLOWED = {
    ("model.py", "capture"): "Capture.from_arrays checks the arrays, when it is called",
    ("model.py", "export"): "Result.mesh and .point_cloud are what mesh.ply holds, when called",
}

# These names may be imported by these files only.
RESERVED = {
    "dask": ("batch/",),
    "distributed": ("batch/",),
    "click": ("cli/",),
    "rich": ("cli/",),
}


def name_of(path):
    return path.relative_to(PACKAGE).as_posix()


def room_of(name):
    return name.split("/")[0].removesuffix(".py")


def imported(path):
    """Full names of all that a file imports, at its top and in its functions."""
    package = ("rakelight", *path.relative_to(PACKAGE).parts[:-1])
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*start, *filter(None, [node.module])))
            names |= {f"{base}.{alias.name}" for alias in node.names}
    return names


def rooms_imported(path):
    """The rooms of rakelight that a file imports from."""
    parts = (name.split(".") for name in imported(path))
    return {names[1] for names in parts if names[0] == "rakelight" and len(names) > 1}


def measured_constants(path):
    """Names and values of the numbers with four digits or more at the top of a file."""
    for node in ast.parse(path.read_text()).body:
        value = getattr(node, "value", None)
        if isinstance(node, ast.Assign) and isinstance(value, ast.Constant):
            digits = str(value.value).split("e")[0].replace(".", "").strip("0")
            if isinstance(value.value, float) and len(digits) >= 4:
                yield node.targets[0].id, value.value


def test_a_number_has_one_home():
    homes = {}
    for path in SOURCES:
        for name, value in measured_constants(path):
            homes.setdefault(value, []).append((name_of(path), name))
    assert 1.4826 in homes
    assert {value: places for value, places in homes.items() if len(places) > 1} == {}


def test_the_parser_sees_every_kind_of_import(tmp_path, monkeypatch):
    monkeypatch.setattr(f"{__name__}.PACKAGE", tmp_path)
    (tmp_path / "room").mkdir()
    file = tmp_path / "room" / "one.py"
    file.write_text(
        "import rakelight.a\nfrom rakelight import b\nfrom rakelight.c.d import e\n"
        "from . import f\nfrom ..g import h\n"
        "def late():\n    from rakelight.i import j\n"
        "if TYPE_CHECKING:\n    import numpy.linalg as k\n"
    )
    assert rooms_imported(file) == {"a", "b", "c", "room", "g", "i"}
    assert "numpy.linalg" in imported(file)


def test_every_file_has_a_room():
    rooms = {room_of(name_of(path)) for path in SOURCES} - {"__init__"}
    assert rooms <= set(HEIGHT), "give a new room its place in LAYERS"


# rakelight/__init__.py names the public names of every room, and loads them on use.
@pytest.mark.parametrize(
    "path", [p for p in SOURCES if p.parent != PACKAGE or p.stem != "__init__"], ids=name_of
)
def test_imports_go_upwards_only(path):
    name = name_of(path)
    room = room_of(name)
    for other in rooms_imported(path) - {room}:
        if other == "__version__" or (name, other) in ALLOWED:
            continue
        assert HEIGHT[other] < HEIGHT[room], f"{name} imports from rakelight.{other}"


def test_the_exceptions_are_still_needed():
    for name, room in ALLOWED:
        assert room in rooms_imported(PACKAGE / name), f"{name} no longer imports {room}"


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_reserved_imports(path):
    for package in {full.split(".")[0] for full in imported(path)} & set(RESERVED):
        assert name_of(path).startswith(RESERVED[package])


METHOD_FILES = [path for path in SOURCES if room_of(name_of(path)) == "methods"]


@pytest.mark.parametrize("path", METHOD_FILES, ids=name_of)
def test_methods_touch_no_files(path):
    roots = {full.split(".")[0] for full in imported(path)}
    assert not roots & {"os", "io", "pathlib", "shutil", "tempfile", "cv2"}
    assert "open" not in set(calls(path))


def calls(path):
    """What a file calls, as written: `print`, `sys.exit`, …"""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func)


LIBRARY = [path for path in SOURCES if room_of(name_of(path)) != "cli"]


@pytest.mark.parametrize("path", LIBRARY, ids=name_of)
def test_the_library_never_prints_or_exits(path):
    forbidden = {"print", "input", "exit", "quit", "sys.exit", "os._exit", "click.echo"}
    assert not forbidden & set(calls(path))
    tree = ast.walk(ast.parse(path.read_text()))
    raised = {ast.unparse(node.exc) for node in tree if isinstance(node, ast.Raise) and node.exc}
    assert not any(what.startswith("SystemExit") for what in raised)
    written = {"sys.stdout", "sys.stderr", "stdout.write", "stderr.write"}
    attributes = {ast.unparse(n) for n in ast.walk(ast.parse(path.read_text())) if is_attribute(n)}
    assert not written & attributes


def is_attribute(node):
    return isinstance(node, ast.Attribute)


def loaded_by(statement):
    """The top-level modules in a fresh interpreter after `statement`."""
    code = f"import sys; {statement}; print(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return set(done.stdout.split())


HEAVY = {"numba", "llvmlite", "scipy", "cv2", "trimesh", "jinja2", "matplotlib", "dask"}


def test_import_is_light():
    assert not loaded_by("import rakelight") & (HEAVY | {"numpy", "msgspec", "click", "rich"})


def test_the_program_starts_light():
    assert not loaded_by("import rakelight.cli") & (HEAVY | {"numpy", "msgspec", "rich"})


def test_reading_a_capture_compiles_nothing():
    loaded = loaded_by("import rakelight; rakelight.load_capture")
    assert "numpy" in loaded
    assert not loaded & (HEAVY - {"cv2"})
    assert not loaded_by("import rakelight; rakelight.refine") & {"numba", "trimesh"}


def reached(names):
    """The files whose code those of these names can call, late imports included."""
    files, waiting = set(), {PACKAGE / name for name in names}
    while waiting:
        path = waiting.pop()
        files.add(path)
        if name_of(path) == "model.py":  # whoever calls Capture.from_arrays: not they
            continue
        for full in imported(path):
            parts = full.split(".")
            for end in range(len(parts), 1, -1):
                module = PACKAGE.joinpath(*parts[1:end])
                found = [module.with_suffix(".py"), module / "__init__.py"]
                found = [file for file in found if parts[0] == "rakelight" and file.is_file()]
                if found:
                    waiting |= set(found) - files
                    break
    return {name_of(path) for path in files}


def test_what_is_checked_beside_the_preparation_runs_no_kernel():
    # Two kernels on all cores at a time would end the process where numba has its own thread pool.
    files = reached(["check/camera_motion.py", "check/depth_shift.py"])
    assert "prepare/sensor.py" in files
    assert not {name for name in files if room_of(name) in ("solve", "shading")}
    assert not {name for name in files if "import prange" in (PACKAGE / name).read_text()}
    assert "solve/multigrid.py" in reached(["prepare/inpaint.py"])
