"""Threads that import parts of scipy, or methods, at the same moment, each for the first time."""

import ast
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from threading import Event

import pytest

from rakelight.methods import METHODS, Method, load_method, method_of
from tests.test_layers import SOURCES

# The main thread begins to import scipy.linalg.  Before it is in sys.modules, another thread calls
# its first kernel, and numba imports scipy.linalg.cython_blas: it has that one's lock and waits for
# scipy.linalg; the main thread has scipy.linalg's lock and soon needs cython_blas.
AT_THE_SAME_MOMENT = """
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.machinery import PathFinder
from threading import Event, current_thread, main_thread

import numpy as np

begun, asked = Event(), Event()


class Slow:
    def find_spec(self, name, path=None, target=None):
        if name != "scipy.linalg" or current_thread() is not main_thread():
            return None
        spec = PathFinder.find_spec(name, path)
        create = spec.loader.create_module

        def slow(spec):
            begun.set()
            asked.wait(1.0)
            return create(spec)

        spec.loader.create_module = slow
        return spec


def hook(event, arguments):
    if event == "import" and arguments[0] == "scipy.linalg.cython_blas" and begun.is_set():
        asked.set()


def first_kernel():
    begun.wait()
    from rakelight.geometry.derivatives import gradient_image

    return gradient_image(np.ones((4, 4)), np.ones((4, 4), bool))


sys.addaudithook(hook)
sys.meta_path.insert(0, Slow())
with ThreadPoolExecutor(1) as pool:
    beside = pool.submit(first_kernel)
    import scipy.linalg

    beside.result()
"""


def test_a_first_kernel_while_another_thread_imports_scipy():
    command = [sys.executable, "-c", AT_THE_SAME_MOMENT]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def parts_imported():
    """The packages of scipy's packages that our files import by their full names."""
    parts = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scipy."):
                parts.add(node.module)
            elif isinstance(node, ast.Import):
                parts |= {each.name for each in node.names if each.name.startswith("scipy.")}
    return sorted(part for part in parts if part.count(".") > 1)


@pytest.mark.parametrize("part", parts_imported())
def test_no_package_of_scipy_imports_the_part_that_we_ask_for(part):
    """Else two threads wait for each other: `from scipy.spatial import transform` is safe."""
    code = f"import sys, {part.rpartition('.')[0]}; print({part!r} in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@dataclass(frozen=True)
class Options:
    """Of a method whose module takes its time to load."""


class SlowMethod:
    """Finds and loads the module of such a method: `half` is set half way, then it waits."""

    def __init__(self, name):
        self.name, self.half, self.asked = name, Event(), Event()

    def find_spec(self, name, path=None, target=None):
        return ModuleSpec(name, self) if name == self.name else None

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        self.half.set()
        self.asked.wait(10)
        module.METHOD = Method("slow", lambda *_: None, Options)


def test_a_method_that_another_thread_is_importing_is_not_loaded_yet(monkeypatch):
    """As when the first calls of `refine` are made by two threads at once."""
    slow = SlowMethod("rakelight.methods.slow")
    monkeypatch.setattr(sys, "meta_path", [slow, *sys.meta_path])
    monkeypatch.setattr("rakelight.methods.slow", None, raising=False)  # taken away afterwards
    monkeypatch.setitem(METHODS, "slow", "slow")
    with ThreadPoolExecutor(1) as pool:
        loading = pool.submit(load_method, "slow")
        try:
            assert slow.half.wait(10)
            assert method_of(Options()) is None
        finally:
            slow.asked.set()
        assert loading.result().options is Options
    assert method_of(Options()) == "slow"
    del sys.modules[slow.name]
