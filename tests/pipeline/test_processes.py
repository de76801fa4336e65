"""`refine` in several threads and in forked processes gives what it gives alone."""

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from threading import Event
from time import sleep

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import rakelight
from rakelight.jit import one_blas_thread
from rakelight.methods.multi_light import MultiLight
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")


def make_scene():
    """Enough pixels that kernels run on all cores."""
    vase = make_shape("vase")
    options = SceneOptions(camera=vase.camera.scaled(0.4), photographs=4, depth_factor=2)
    return render_scene(vase, make_albedo("pattern"), options)


def refine(capture):
    """A step or two at each level."""
    return rakelight.refine(capture, MultiLight(max_iterations=1))


run = refine


@pytest.fixture(autouse=True)
def no_hang():
    """What hangs fails, and does not keep the others waiting."""
    if not hasattr(signal, "alarm"):
        yield
        return

    def too_long(*_):
        raise TimeoutError("this should have taken seconds")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(120)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def same(first, second):
    return np.array_equal(first.depth, second.depth, equal_nan=True)


def in_child(work):
    """The exit code of a forked process: 0 where `work()` is true."""
    child = os.fork()
    if child == 0:
        code = 9
        try:
            code = 0 if work() else 8
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1]


def test_two_threads_at_once(capture, result):
    with ThreadPoolExecutor(2) as pool:
        for each in pool.map(refine, [capture, capture]):
            assert same(each, result)


@forks
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_fork_after_the_first_refine(capture, result):
    def child():
        return (
            same(refine(capture), result) and in_child(lambda: same(refine(capture), result)) == 0
        )

    assert in_child(child) == 0
    assert same(refine(capture), result)


@forks
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_pools_of_forked_processes(capture, result):
    context = multiprocessing.get_context("fork")
    with context.Pool(2) as pool:
        assert all(same(each, result) for each in pool.map(refine, [capture, capture]))
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        assert all(same(each, result) for each in pool.map(refine, [capture, capture]))


@forks
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_thread_of_a_forked_process(capture, result):
    def child():
        with ThreadPoolExecutor(1) as pool:
            return same(pool.submit(refine, capture).result(), result)

    assert in_child(child) == 0


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_overlapping_threads_leave_the_number_of_blas_threads_as_it_was():
    with threadpool_limits(2, user_api="blas"), ThreadPoolExecutor(1) as pool:
        for _ in range(2):
            here, there = one_blas_thread(), one_blas_thread()
            here.__enter__()
            pool.submit(there.__enter__).result()
            here.__exit__(None, None, None)
            assert blas_threads() == {1}
            pool.submit(there.__exit__, None, None, None).result()
            assert blas_threads() == {2}


@pytest.mark.parametrize("module", ["pipeline", "checkup"])
def test_no_check_runs_while_the_number_of_blas_threads_changes(module, capture, monkeypatch):
    """A product that is computed meanwhile might wait for threads that are gone."""
    seen = []

    def check(measured):
        seen.append(blas_threads())
        return ()

    monkeypatch.setattr(f"rakelight.{module}.checks", lambda **stage: {check: "too-soft"})
    with threadpool_limits(2, user_api="blas"):
        {"pipeline": refine, "checkup": rakelight.check_capture}[module](capture)
        assert blas_threads() == {2}
    assert seen
    assert all(each == {1} for each in seen)


@forks
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_fork_while_another_thread_sets_the_number_of_blas_threads(monkeypatch):
    begun = Event()

    def slow(*limits, **user_api):
        begun.set()
        sleep(0.1)
        return threadpool_limits(*limits, **user_api)

    def enter():
        with one_blas_thread():
            return blas_threads() == {1}

    def child():
        signal.alarm(5)
        return enter()

    monkeypatch.setattr("threadpoolctl.threadpool_limits", slow)
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(enter)
        begun.wait()
        assert in_child(child) == 0
        assert other.result()
