"""Time and memory of the depth solve against PyAMG, SuperLU and Jacobi, on rough tensors.

    python benchmarks/solver.py --json --size 1024     all solvers, one system
    python benchmarks/solver.py --iterations           iterations from 64 x 64 to 2048 x 2048

Every solver starts from zero and runs, set-up included, until |rhs - A x| <= 1e-6 |rhs|, in a
process of its own.  `peak_mib` is all that it ever held, interpreter, libraries and system too;
`added_mib` what the solve added to that.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

TOLERANCE = 1e-6
SOLVERS = ("ours", "pyamg", "superlu", "jacobi")


def rough_problem(size: int) -> tuple[Any, ...]:
    """A disc of random tensors: any direction, 1:10, two decades; data weights 1e-4 to 1e-2."""
    rng = np.random.default_rng(0)
    shape = (size, size)
    row, column = np.indices(shape) - (size - 1) / 2
    angle, large = rng.uniform(0, np.pi, shape), 10 ** rng.uniform(-1, 1, shape)
    small, cos, sin = large / 10, np.cos(angle), np.sin(angle)
    tensor = [large * cos**2 + small * sin**2, (large - small) * cos * sin]
    tensor.append(large * sin**2 + small * cos**2)
    return (
        np.hypot(row, column) < 0.49 * size,
        np.stack(tensor, axis=-1),
        0.1 * large[..., None] * rng.normal(size=(*shape, 2)),
        10 ** rng.uniform(-4, -2, shape),
        rng.normal(size=shape),
    )


def run_ours(file: Path) -> tuple[float, float, float]:
    """Seconds, residual, MiB before the solve; compiled before the clock starts."""
    from rakelight.solve import DepthSystem, assemble, solve

    solve(assemble(*rough_problem(64)))
    stored = np.load(file)
    system = DepthSystem(*(stored[k] for k in ("stencil", "rhs", "zero", "mask", "none")))
    before, began = held_mib("VmRSS"), perf_counter()
    solution = solve(system, tolerance=TOLERANCE)
    return perf_counter() - began, solution.relative_residual, before


def run_other(name: str, file: Path) -> tuple[float, float, float]:
    """Seconds, residual, MiB before the solve, of a solver for general sparse matrices."""
    import pyamg
    from scipy import sparse

    stored = np.load(file)
    matrix = sparse.csr_matrix((stored["data"], stored["indices"], stored["indptr"]))
    b = stored["b"]
    before, began = held_mib("VmRSS"), perf_counter()
    if name == "pyamg":
        levels = pyamg.ruge_stuben_solver(matrix)
        x = levels.solve(b, tol=TOLERANCE, accel="cg", maxiter=200)
    elif name == "superlu":
        from scipy.sparse.linalg import splu

        factors = splu(
            matrix.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        x = factors.solve(b)
    else:
        from scipy.sparse.linalg import cg

        jacobi = sparse.diags(1 / matrix.diagonal())
        x, _ = cg(matrix, b, rtol=TOLERANCE, M=jacobi, maxiter=20000)
    seconds = perf_counter() - began
    return seconds, float(np.linalg.norm(b - matrix @ x) / np.linalg.norm(b)), before


def store(size: int, file: Path) -> int:
    """Write the system of this size for the solvers' processes; the number of unknowns."""
    from rakelight.solve import assemble

    system = assemble(*rough_problem(size))
    matrix = system.to_sparse()
    np.savez(
        file,
        stencil=system.stencil,
        rhs=system.rhs,
        zero=np.zeros_like(system.rhs),
        mask=system.mask,
        none=np.zeros_like(system.mask),
        data=matrix.data,
        indices=matrix.indices.astype(np.int32),
        indptr=matrix.indptr.astype(np.int32),
        b=system.rhs[system.mask],
    )
    return system.unknowns


def compare(size: int, solvers: list[str]) -> dict[str, Any]:
    """Every solver on the same system; seconds, residuals, MiB and the ratio to PyAMG."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "system.npz"
        result: dict[str, Any] = {"size": size, "unknowns": store(size, file)}
        result |= {"residual": {}, "peak_mib": {}, "added_mib": {}}
        for name in solvers:
            command = [sys.executable, __file__, "--one", name, "--file", str(file)]
            answer = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            result[f"{name}_s"] = round(answer["seconds"], 3)
            result["residual"][name] = answer["residual"]
            for key in ("peak_mib", "added_mib"):
                result[key][name] = round(answer[key])
    if "pyamg" in solvers:
        result["ratio_pyamg"] = round(result["pyamg_s"] / result["ours_s"], 1)
        added = result["added_mib"]
        result["ratio_memory"] = round(added["pyamg"] / added["ours"], 1)
    return result


def iterations() -> list[dict[str, Any]]:
    """Iterations and seconds of our solver over a range of sizes."""
    from rakelight.solve import assemble, build_hierarchy, solve

    rows = []
    solve(assemble(*rough_problem(64)))
    for size in (64, 128, 256, 512, 1024, 2048):
        problem = rough_problem(size)
        t0 = perf_counter()
        system = assemble(*problem)
        t1 = perf_counter()
        hierarchy = build_hierarchy(system)
        t2 = perf_counter()
        solution = solve(system, hierarchy=hierarchy, tolerance=TOLERANCE)
        rows.append(
            {
                "size": size,
                "unknowns": system.unknowns,
                "iterations": solution.iterations,
                "assemble_s": round(t1 - t0, 4),
                "setup_s": round(t2 - t1, 4),
                "solve_s": round(solution.seconds, 4),
            }
        )
    return rows


def one(name: str, file: Path) -> dict[str, Any]:
    """What a solver's own process reports."""
    seconds, residual, before = run_ours(file) if name == "ours" else run_other(name, file)
    peak = held_mib("VmHWM")
    return {"seconds": seconds, "residual": residual, "peak_mib": peak, "added_mib": peak - before}


def held_mib(what: str) -> float:
    """Memory of this process: VmRSS now, VmHWM at most so far (Linux; elsewhere always that)."""
    status = Path("/proc/self/status")
    if status.exists():  # ru_maxrss would carry over from the parent process
        lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return int(lines[what].split()[0]) / 1024
    unit = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def main() -> None:
    """Read the command line, print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=1088, help="pixels along a side")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--iterations", action="store_true", help="iterations from 64 to 2048")
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=SOLVERS)
    parser.add_argument("--one", choices=SOLVERS, help=argparse.SUPPRESS)
    parser.add_argument("--file", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(one(arguments.one, arguments.file)))
        return
    result = iterations() if arguments.iterations else compare(arguments.size, arguments.solvers)
    if arguments.json:
        print(json.dumps(result, indent=2))
    else:
        for row in result if isinstance(result, list) else [result]:
            print("  ".join(f"{key} {value}" for key, value in row.items()))


if __name__ == "__main__":
    main()
