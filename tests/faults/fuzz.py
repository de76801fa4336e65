"""Thousands of damaged files: each is read, or refused with one clear line; nothing else.

    python -m tests.faults.fuzz [--cases N] [--seed S]

Not: another exception than an InputError, a word on stderr, more than 10 seconds or 2 GB, the end
of the interpreter.  A case is a seed and a number; its file is the same each time.  The file of
a case that fails is kept under out/fuzz.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import secrets
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from random import Random
from resource import RUSAGE_CHILDREN, getrusage

SECONDS = 10  # that a case may take
MEMORY = 3 << 29  # bytes that a case may take; with what the libraries hold, less than 2 GB
CHILD_MEMORY = 2e9  # bytes that a decoder in a process of its own may take
WORKER = (sys.executable, "-m", "tests.faults.fuzz", "--worker")
WORKERS = 2
ROOT = Path(__file__).resolve().parents[2]
PYTHONPATH = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])


@dataclass(frozen=True)
class Outcome:
    """Of one case: `what` is "read", "refused", or what went wrong."""

    case: int
    kind: str
    what: str

    @property
    def failed(self) -> bool:
        """Whether it is one to look at."""
        return self.what not in ("read", "refused")


class Cases:
    """The damaged files of a seed, by their numbers."""

    def __init__(self, seed: int, folder: Path) -> None:
        from tests.faults.sound_files import make_kinds

        self.seed = seed
        self.kinds = make_kinds(folder)
        self.sound = [kind.path.read_bytes() for kind in self.kinds]

    def file(self, case: int) -> bytes:
        """The bytes of one case; the first of each kind is undamaged."""
        from tests.faults.mutations import mutated

        number, count = case % len(self.kinds), len(self.kinds)
        random = Random(f"{self.seed} {case}")
        sound = self.sound[number]
        return sound if case < count else mutated(random, sound, random.choice(self.sound))

    def run(self, case: int) -> Outcome:
        """Read the file of one case in its place."""
        number = case % len(self.kinds)
        kind, said = self.kinds[number], os.fstat(2).st_size
        kind.path.write_bytes(self.file(case))
        what = tried(kind.read)
        kind.path.write_bytes(self.sound[number])
        if case < len(self.kinds) and what == "refused":
            what = "the undamaged file was refused"
        most = getrusage(RUSAGE_CHILDREN).ru_maxrss * 1024  # of decoders that have ended
        if most > CHILD_MEMORY:
            what = f"a decoder took {most / 1e9:.1f} GB; {what}"
        if os.fstat(2).st_size > said:
            words = " ".join(os.pread(2, 200, said).decode(errors="replace").split())
            what = f"printed {words!r} on stderr; {what}"
        return Outcome(case, kind.name, what)


def tried(read: object) -> str:
    """What comes of it: "read", "refused", or the exception."""
    from rakelight.errors import InputError

    try:
        read()  # type: ignore[operator]
    except InputError as error:
        line = str(error)
        return "refused" if line.isprintable() and len(line) < 3000 else f"message {line[:80]!r}"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        message = " ".join(str(error).split())[:200]
        return f"{type(error).__name__}: {message} ({Path(where.filename).name}:{where.lineno})"
    return "read"


def work(seed: int, start: int, stop: int, step: int) -> None:
    """Run every `step`-th case from `start`, one line each on stdout; ours alone is stderr."""
    with tempfile.TemporaryDirectory() as scratch:
        cases = Cases(seed, Path(scratch) / "files")
        for kind in cases.kinds:
            kind.read()  # all is imported and compiled
        limit_memory()
        for case in range(start, stop, step):
            faulthandler.dump_traceback_later(SECONDS, exit=True)
            outcome = cases.run(case)
            faulthandler.cancel_dump_traceback_later()
            print(outcome.case, outcome.kind, outcome.what, sep="\t", flush=True)


def limit_memory() -> None:
    """No more address space than MEMORY beyond what stands now, which holds reserved room."""
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def outcomes(seed: int, start: int, stop: int, step: int, command: tuple[str, ...]) -> Iterator:
    """Of every `step`-th case; a worker that ends early is followed by another."""
    case = start
    while case < stop:
        with tempfile.TemporaryFile() as said:
            numbers = map(str, (seed, case, stop, step))
            environment = {**os.environ, "PYTHONPATH": PYTHONPATH}
            options = {"stdout": subprocess.PIPE, "stderr": said, "text": True, "env": environment}
            with subprocess.Popen([*command, *numbers], **options) as worker:
                for line in worker.stdout:
                    number, kind, what = line.rstrip("\n").split("\t")
                    case = int(number) + step
                    yield Outcome(int(number), kind, what)
            if case < stop:
                said.seek(0)
                last = said.read().decode(errors="replace").strip().splitlines()[:8]
                yield Outcome(case, "?", f"ended with {worker.returncode}: {' | '.join(last)}")
                case += step


def fuzz(
    seed: int, cases: int, workers: int = WORKERS, command: tuple[str, ...] = WORKER
) -> list[Outcome]:
    """All cases from 0 of a seed, in processes of their own."""

    def share(start: int) -> list[Outcome]:
        return list(outcomes(seed, start, cases, workers, command))

    with ThreadPoolExecutor(workers) as pool:
        shares = pool.map(share, range(workers))
        return sorted((o for share in shares for o in share), key=lambda outcome: outcome.case)


def keep(seed: int, failed: list[Outcome], folder: Path) -> None:
    """Write the files of cases that failed, and beside each what came of it."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        cases = Cases(seed, Path(scratch) / "files")
        for outcome in failed:
            kind = cases.kinds[outcome.case % len(cases.kinds)]
            name = f"{seed}-{outcome.case}-{kind.name.replace('/', '-')}"
            (folder / name).write_bytes(cases.file(outcome.case))
            (folder / f"{name}.txt").write_text(f"{kind.name}: {outcome.what}\n")


def report(seed: int, ran: list[Outcome], seconds: float) -> str:
    """A line of numbers per kind, and one per failure."""
    counts = {kind: Counter() for kind in sorted({outcome.kind for outcome in ran})}
    for outcome in ran:
        counts[outcome.kind]["failed" if outcome.failed else outcome.what] += 1
    lines = [f"{'kind':22} {'refused':>8} {'read':>8} {'failed':>8}"]
    lines += [
        f"{kind:22} {count['refused']:8} {count['read']:8} {count['failed']:8}"
        for kind, count in counts.items()
    ]
    failed = [outcome for outcome in ran if outcome.failed]
    lines += [f"FAILED {o.case} {o.kind}: {o.what}" for o in failed]
    lines.append(f"seed {seed}: {len(ran)} cases, {len(failed)} failed, {seconds:.0f} s")
    return "\n".join(lines)


def main() -> int:
    """Run a fixed seed and a fresh one, or the one that is given."""
    if sys.argv[1:2] == ["--worker"]:
        work(*map(int, sys.argv[2:6]))
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=10_000, help="in all")
    parser.add_argument("--seed", type=int, help="only this one")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="for what failed")
    given = parser.parse_args()
    seeds = [1, secrets.randbelow(10**6)] if given.seed is None else [given.seed]
    any_failed = False
    for seed in seeds:
        print(f"seed {seed} (again with SEED={seed})", flush=True)
        start = time.monotonic()
        ran = fuzz(seed, given.cases // len(seeds))
        print(report(seed, ran, time.monotonic() - start), flush=True)
        failed = [outcome for outcome in ran if outcome.failed]
        if failed:
            any_failed = True
            keep(seed, failed, given.out)
            print(f"their files are in {given.out}")
    return int(any_failed)


if __name__ == "__main__":
    sys.exit(main())
