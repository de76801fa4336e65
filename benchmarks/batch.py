"""Many captures: what `rakelight batch` survives, how fast it is, and what 10,000 would cost.

    python -m benchmarks.batch storm         40 small captures, two broken; workers and run killed
    python -m benchmarks.batch throughput    two worker processes against refine on one core
    python -m benchmarks.batch scale         10,000 captures on 1, 8, 64 machines, computed twice

`storm` ends with exit code 1 where something was lost, computed once too often or left behind.
`scale` takes the seconds of a batch.json (--times), or of captures that it makes.
"""

from __future__ import annotations

import argparse
import heapq
import json
import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PROGRAM = (sys.executable, "-c", "from rakelight.cli import main; main()")
MACHINES = (1, 8, 64)
CAPTURES = 10_000


def make_captures(folder: Path, count: int, size: float, photographs: tuple[int, int]) -> None:
    """Synthetic captures of objects, sizes and numbers of photographs in turn."""
    from rakelight.capture import write_capture
    from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

    shapes = ("vase", "head", "coin", "sphere")
    for i in range(count):
        solid = make_shape(shapes[i % len(shapes)])
        least, most = photographs
        options = SceneOptions(
            camera=solid.camera.scaled(size * (0.7 + 0.3 * (i % 3) / 2)),
            photographs=least + i % (most - least + 1),
            seed=i,
        )
        capture, _ = render_scene(solid, make_albedo("pattern", i), options)
        write_capture(capture, folder / f"capture{i:03d}", depth_scale=10_000)


def begin(*arguments: object, **options: Any) -> subprocess.Popen[bytes]:
    """Start the command."""
    return subprocess.Popen([*PROGRAM, *map(str, arguments)], **options)


def results(out: Path) -> dict[str, tuple[int, int]]:
    """inode and time of every whole result."""
    return {
        path.parent.name: (path.stat().st_ino, path.stat().st_mtime_ns)
        for path in out.glob("[!.]*/result.json")
    }


# --- storm ---

# The run is killed when half of the captures are done, and eight more are to do.
FEWEST_IN_A_STORM = 16


def storm(count: int, seed: int) -> int:
    """Captures of which two are broken, while workers and then the whole run are killed."""
    chance, wrong = random.Random(seed), []
    with tempfile.TemporaryDirectory() as scratch:
        captures, out = Path(scratch) / "captures", Path(scratch) / "out"
        make_captures(captures, count - 2, 0.1, (4, 6))
        broken = shutil.copytree(captures / "capture000", captures / "broken")
        (broken / "rgb" / "001.png").write_bytes(b"no picture")
        (captures / "empty").mkdir()
        command = ("batch", f"{captures}/*", "-o", out, "--workers", 2)
        seen: dict[str, tuple[int, int]] = {}
        kills = (chance.randint(1, count // 3), chance.randint(count // 2, count - 8))
        for round_, (killed, at) in enumerate((("a worker", kills[0]), ("the run", kills[1]))):
            run, family = begin(*command, stderr=subprocess.DEVNULL), []
            while len(results(out)) < at and run.poll() is None:
                time.sleep(0.02)
            time.sleep(chance.random() * 0.5)
            family = children(run.pid)
            if round_ == 0:
                chance.choice([each for each in family if is_worker(each)]).kill()
                while len(results(out)) < at + 3 and run.poll() is None:
                    time.sleep(0.02)
            run.kill()
            run.wait()
            wrong += survivors(family)
            wrong += recomputed(seen, results(out))
            seen = results(out)
            print(f"killed {killed} after {at} results: {len(seen)} are whole", flush=True)
        code = begin(*command).wait()
        wrong += recomputed(seen, results(out))
        wrong += [f"exit code {code}"] if code != 4 else []
        whole = len(results(out))
        wrong += [f"{whole} results"] if whole != count - 2 else []
        left = {path.name for path in Path(scratch).rglob(".*")}
        wrong += [f"left behind: {name}" for name in left]
    print("\n".join(wrong) or f"{whole} of {count - 2} whole, computed once, exit code {code}")
    return int(bool(wrong))


def children(pid: int) -> list[Any]:
    """The processes that this one started, and theirs."""
    import psutil

    try:
        return list(psutil.Process(pid).children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def is_worker(process: Any) -> bool:
    """Whether it is a worker of Dask's."""
    return "spawn_main" in " ".join(process.cmdline())


def survivors(family: list[Any]) -> list[str]:
    """What is said of processes that outlive their run by more than five seconds."""
    import psutil

    _, alive = psutil.wait_procs(family, timeout=5)
    alive = [each for each in alive if each.status() != psutil.STATUS_ZOMBIE]
    return [f"still running: {each.pid}" for each in alive]


def recomputed(before: dict[str, tuple[int, int]], now: dict[str, tuple[int, int]]) -> list[str]:
    """What is said of results that are not the ones that were there before."""
    return [f"computed again: {name}" for name in before if now.get(name) != before[name]]


# --- throughput ---


def throughput(count: int, rounds: int, size: float) -> dict[str, Any]:
    """Captures per minute of two workers, and of `refine` on one core; interleaved, the medians."""
    seconds: dict[str, list[float]] = {"one core": [], "two workers": []}
    with tempfile.TemporaryDirectory() as scratch:
        captures, out = Path(scratch) / "captures", Path(scratch) / "out"
        make_captures(captures, count, size, (6, 12))
        timed(lambda: batch(captures, out, 2))  # compiles
        for _ in range(rounds):
            seconds["one core"].append(timed(lambda: one_by_one(captures, out)))
            shutil.rmtree(out)
            seconds["two workers"].append(timed(lambda: batch(captures, out, 2)))
            times = seconds_of(out / "batch.json")
    one, two = (statistics.median(seconds[kind]) for kind in seconds)
    return {
        "captures": count,
        "one_core_s": [round(each, 2) for each in seconds["one core"]],
        "two_workers_s": [round(each, 2) for each in seconds["two workers"]],
        "times_faster": round(one / two, 2),
        "capture_s": [round(each, 2) for each in times],
    }


def timed(work: Callable[[], None]) -> float:
    """Seconds that it takes."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def batch(captures: Path, out: Path, workers: int) -> None:
    """All of them, anew."""
    shutil.rmtree(out, ignore_errors=True)
    if begin("batch", f"{captures}/*", "-o", out, "--workers", workers, "--quiet").wait():
        raise SystemExit("the batch failed")


def one_by_one(captures: Path, out: Path) -> None:
    """Each by a `refine` of its own that may use one core."""
    shutil.rmtree(out, ignore_errors=True)
    core = {min(os.sched_getaffinity(0))}
    for path in sorted(captures.iterdir()):
        process = begin(
            "refine", path, "-o", out / path.name, "--quiet",
            env={**os.environ, "NUMBA_NUM_THREADS": "1"},
            preexec_fn=lambda: os.sched_setaffinity(0, core),
        )  # fmt: skip
        if process.wait():
            raise SystemExit(f"refine failed on {path}")


def seconds_of(record: Path) -> list[float]:
    """Of one core for every capture that a batch computed: other work on the machine adds none."""
    captures = json.loads(record.read_text())["captures"]
    return [each["cpu_s"] for each in captures if each["computed"]]


# --- scale ---


def on_paper(
    times: list[float], workers: int, count: int, start_s: float, answer_s: float
) -> float:
    """Seconds: the start, the slower of workers and first process, half the longest at the end."""
    work, answers = count * statistics.fmean(times) / workers, count * answer_s
    return start_s + max(work, answers) + max(times) / 2


def simulated(
    times: list[float], workers: int, count: int, start_s: float, answer_s: float, seed: int = 0
) -> float:
    """Seconds until the last of `count` captures, their times drawn from those measured.

    A worker that has done one waits until the first process has taken its answer and sent the
    next, which it does for one worker at a time.
    """
    chance = random.Random(seed)
    free = [(start_s, worker) for worker in range(workers)]
    heapq.heapify(free)
    answered = last = start_s
    for _ in range(count):
        ready, worker = heapq.heappop(free)
        answered = max(answered, ready) + answer_s
        end = answered + chance.choice(times)
        last = max(last, end)
        heapq.heappush(free, (end, worker))
    return last + answer_s


def answer_seconds(count: int = 300) -> tuple[float, float]:
    """Seconds to start two workers, and of the first process for each capture that they do."""
    from rakelight.batch import run
    from rakelight.batch.cluster import local_client
    from rakelight.batch.plan import Job

    began = time.perf_counter()
    with local_client(2, {}) as client:
        start_s = time.perf_counter() - began
        run.run_one = nothing  # type: ignore[assignment]
        jobs = [Job(f"/none/{i}", f"{i}") for i in range(count)]
        list(run._answers(client, jobs[:20], (), {}))
        began = time.perf_counter()
        list(run._answers(client, jobs[20:], (), {}))
        return start_s, (time.perf_counter() - began) / (count - 20)


def nothing(job: Any, *_: object) -> Any:
    """A job without work."""
    from rakelight.batch.record import Entry

    return Entry(source=job.shown, name=job.name, state="done")


def scale(times: list[float], cores: int) -> list[dict[str, Any]]:
    """A row for each number of machines."""
    start_s, answer_s = answer_seconds()
    print(
        f"{len(times)} measured captures, {statistics.fmean(times):.2f} s each on one core "
        f"({min(times):.2f} to {max(times):.2f}); start {start_s:.1f} s, "
        f"{1000 * answer_s:.1f} ms of the first process for each capture"
    )
    rows = []
    for machines in MACHINES:
        given = (times, machines * cores, CAPTURES, start_s, answer_s)
        paper, simulation = on_paper(*given), simulated(*given)
        rows.append(
            {
                "machines": machines,
                "workers": machines * cores,
                "on paper, hours": round(paper / 3600, 3),
                "simulated, hours": round(simulation / 3600, 3),
                "off": f"{paper / simulation - 1:+.1%}",
                "machine hours": round(machines * simulation / 3600, 2),
            }
        )
    return rows


def main() -> None:
    """Do what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["storm", "throughput", "scale"])
    parser.add_argument("--captures", type=int, help="40 in the storm, 8 otherwise")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--size", type=float, default=0.7, help="1 is 480 x 360 pixels")
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    parser.add_argument("--cores", type=int, default=2, help="of a machine in `scale`")
    parser.add_argument("--times", type=Path, help="a batch.json whose seconds `scale` takes")
    given = parser.parse_args()
    if given.what == "storm":
        if given.captures is not None and given.captures < FEWEST_IN_A_STORM:
            parser.error(f"a storm takes at least {FEWEST_IN_A_STORM} captures")
        print(f"seed {given.seed}", flush=True)
        sys.exit(storm(given.captures or 40, given.seed))
    if given.what == "throughput":
        print(json.dumps(throughput(given.captures or 8, given.rounds, given.size), indent=1))
        return
    if given.times:
        times = seconds_of(given.times)
    else:
        times = throughput(given.captures or 8, 1, given.size)["capture_s"]
    rows = scale(times, given.cores)
    print("| " + " | ".join(rows[0]) + " |\n|" + " --- |" * len(rows[0]))
    for row in rows:
        print("| " + " | ".join(str(value) for value in row.values()) + " |")


if __name__ == "__main__":
    main()
