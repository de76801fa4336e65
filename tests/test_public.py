"""The public names: they exist, are documented, and the examples in their docstrings are run."""

import ast
import inspect
import os
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import rakelight
from rakelight.methods import METHODS, load_method
from rakelight.synthetic import random_capture

PACKAGE = Path(rakelight.__file__).resolve().parent
SOURCES = sorted(PACKAGE.rglob("*.py"))


def module_name(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def with_all():
    """The modules that say what is public in them."""
    for path in SOURCES:
        if any(
            isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
            for node in ast.parse(path.read_text()).body
        ):
            yield module_name(path)


EXPORTED = [(module, name) for module in with_all() for name in import_module(module).__all__]
FUNCTIONS = sorted(
    {
        f"{thing.__module__}.{thing.__qualname__}"
        for module, name in EXPORTED
        if inspect.isfunction(thing := getattr(import_module(module), name))
    }
)

# A public function, or its module, shows an example that runs, unless:
WITHOUT_EXAMPLE = {
    "rakelight.capture.truth.load_truth": "needs a synthetic capture on the disk",
    "rakelight.export.reading.load_result": "rakelight.save_result's example reads back with it",
    "rakelight.export.reading.read_summary": "needs a result folder; tests/export read it",
    "rakelight.methods.choose_method": "needs a whole capture; tests/cli run it",
    "rakelight.pipeline.refine": "needs a whole capture; rakelight's own docstring shows it",
    "rakelight.prepare.prepare": "needs a whole capture; tests/prepare run it",
    "rakelight.report.page.report_html": "needs a result, as export.save_result's example makes",
    "rakelight.synthetic.albedo.texture_from_file": "needs a picture on the disk",
    "rakelight.synthetic.depth_file.shape_from_depth": "needs a depth map; its tests show one",
    "rakelight.synthetic.depth_file.shape_from_file": "needs a depth map on the disk",
}


@pytest.mark.parametrize("name", rakelight.__all__)
def test_public_names_resolve(name):
    assert getattr(rakelight, name) is not None


def test_the_three_lists_of_public_names_agree():
    assert rakelight.__all__ == sorted(rakelight.__all__)
    assert dir(rakelight) == rakelight.__all__
    assert set(rakelight._HOMES) == set(rakelight.__all__) - {"__version__"}
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    (typing,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {}
    for node in typing.body:
        for alias in node.names:
            inside = f":{alias.name}" if alias.asname else ""
            typed[alias.asname or alias.name] = node.module + inside
    assert typed == rakelight._HOMES


def test_a_method_has_its_options_under_its_name():
    for name in METHODS:
        public = "".join(word.capitalize() for word in name.split("-"))
        assert getattr(rakelight, public) is load_method(name).options


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'refin'"):
        rakelight.refin  # noqa: B018


@pytest.mark.parametrize(("module", "name"), EXPORTED, ids=[".".join(pair) for pair in EXPORTED])
def test_exported_names_are_documented(module, name):
    thing = getattr(import_module(module), name)
    if inspect.isclass(thing) or inspect.isfunction(thing):
        assert len(inspect.getdoc(thing) or "") > 20
        assert thing.__module__.startswith("rakelight.")


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_everything_public_has_a_docstring(path):
    tree = ast.parse(path.read_text())
    documented = (ast.FunctionDef, ast.ClassDef)
    assert ast.get_docstring(tree)
    for node in tree.body:
        if not isinstance(node, documented) or node.name.startswith("_"):
            continue
        assert ast.get_docstring(node), node.name
        methods = node.body if isinstance(node, ast.ClassDef) else []
        for method in methods:
            if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
                assert ast.get_docstring(method), f"{node.name}.{method.name}"


@pytest.mark.parametrize("full_name", FUNCTIONS)
def test_exported_functions_have_an_example(full_name):
    module, _, name = full_name.rpartition(".")
    home = import_module(module)
    own, shared = inspect.getdoc(getattr(home, name)), inspect.getdoc(home)
    shown = ">>>" in own or any(
        line.startswith((">>>", "...")) and f"{name}(" in line for line in shared.splitlines()
    )
    assert "+SKIP" not in own
    if full_name in WITHOUT_EXAMPLE:
        assert not shown, f"{full_name} has an example now: take it off the list"
    else:
        assert shown, f"{full_name} shows no example"


def test_the_exempt_functions_exist():
    assert set(WITHOUT_EXAMPLE) <= set(FUNCTIONS)


def test_errors_carry_their_exit_codes():
    codes = {
        name: getattr(rakelight, name).exit_code
        for name in rakelight.__all__
        if inspect.isclass(getattr(rakelight, name))
        and issubclass(getattr(rakelight, name), Exception)
    }
    assert codes == {
        "RakelightError": 1,
        "InputError": 2,
        "CaptureError": 2,
        "MethodError": 2,
        "OutputExistsError": 2,
        "MachineError": 3,
    }


def test_no_module_hides_behind_a_name():
    assert not [
        name for name in rakelight.__all__ if isinstance(getattr(rakelight, name), ModuleType)
    ]


def test_what_holds_arrays_is_compared_by_identity():
    one, other = (random_capture(0, size=0.2, shape="sphere", photographs=3) for _ in "ab")
    for mine, yours in zip(one, other, strict=True):
        assert mine != yours
        assert [yours, mine].index(mine) == 1
        assert {mine: 1, yours: 2}[yours] == 2


@pytest.mark.parametrize("name", ["load_capture", "load_result", "load_truth"])
@pytest.mark.parametrize("value", [None, 3])
def test_what_is_no_path_is_refused(name, value):
    with pytest.raises(rakelight.InputError, match=r"this is no path .*needed str or pathlib"):
        getattr(rakelight, name)(value)


def test_results_and_captures_are_written_to_paths(tmp_path):
    capture, _ = random_capture(0, size=0.2, shape="sphere", photographs=3)
    with pytest.raises(rakelight.InputError, match="folder: this is no path"):
        rakelight.write_capture(capture, None)
    flat, facing = np.ones((4, 4)), np.tile([0.0, 0.0, -1.0], (4, 4, 1))
    camera = rakelight.Camera(4, 4, 100.0, 100.0, 1.5, 1.5)
    lights = rakelight.Lights(facing[:, :1], flat[:, :1])
    result = rakelight.Result(flat, facing, np.ones((4, 4, 3)), flat, lights, camera, flat, "none")
    with pytest.raises(rakelight.InputError, match="folder: this is no path"):
        rakelight.save_result(result, None)
    rakelight.save_result(result, os.fsencode(tmp_path / "out"))
    assert rakelight.load_result(tmp_path / "out").method == "none"
