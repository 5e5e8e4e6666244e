"""How much less CPU time our adjustment takes than Ceres, at the same cost.

python benchmarks/against_ceres.py [--short] [--images N,N] [--json FILE]
(needs the extra `bench`: pip install -e ".[bench]")

What is compared. Corridors of three strips, some 440 observations an image, 0.5 px of noise; start
values that miss by 0.3 m, 0.003 rad and 0.3 m. Unknown are all poses, all points and f, cx, cy,
k1, k2 of one camera, which is COLMAP's model RADIAL exactly. GNSS positions at the camera centres
(sigma 0.02, 0.02, 0.04 m, lever arm zero and known) are the only datum. Both sides minimise half
the sum of squares over a unit of 0.5 px: our sigmas are stated doubled, so that Ceres need not
weigh its image residuals.

Why it is fair to Ceres. COLMAP's own adjuster builds the problem, with its compiled cost functions
and its manifold of rotations; the position priors are COLMAP's too. Residuals are handed over in
the order in which we use them. Ceres gets one thread, BLAS as well; a trust radius of 1e10, with
which it takes the three steps that we take (eight with its own 1e4); a tolerance with which neither
side takes a step more than the other. At each size every entry of RIVALS is tried once
(SPARSE_SCHUR, with and without scaling of the columns, and DENSE_SCHUR with LAPACK where it is
affordable) and the fastest is measured. Ceres in the packages of pyceres and pycolmap has
SuiteSparse (the script prints it) and no EIGEN_SPARSE; ITERATIVE_SCHUR is not exact.

What is timed. CPU time of the process during the solve: for us `solve(Normal(problem, Loss()))`,
for Ceres `pyceres.solve`, runs in turn, after one of ours that compiles or loads the kernels. What
builds either problem is not timed but printed. Ceres finds for itself that the points are to be
eliminated first (its report says so), because the packages do not let Python state the order; that
is part of its preprocessor, which counts as ours counts the making of `Normal`. The column "no
prep" leaves Ceres' whole preprocessor out: a bound that no order given beforehand can beat.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from strips import corridor_block  # noqa: E402

from corridor.core.adjustment import (
    LOSSES,
    Covariance,
    LinearSystem,
    Loss,
    Normal,
    make_problem,
    solve,
)
from corridor.core.block import Block
from corridor.core.geometry import quaternion_from_rotation
from corridor.core.simulation import CAMLIGHT, add_noise

SHORT = (114, 330)
SIZES = (114, 330, 1080, 5385, 10_767)
# Larger blocks are ours only: Ceres would need more than 5 GB.
CERES_UPTO = 6000
OFTEN_UPTO = 1080
TWO_FROM = 1080
FREE = "f,cx,cy,k1,k2"
GNSS_SIGMA = (0.02, 0.02, 0.04)
TIE_SIGMA = 0.5

NEEDS = {114: 5.0, 330: 6.0, 1080: 12.0, 5385: 14.0}
COST_DIFFERS, GROWTH, PEAK_MB, TWO_THREADS, EVERYTHING = 1e-6, 1.05, 700.0, 1.6, 1.25
EVERY_COVARIANCE = 2.0

# Solver options of Ceres.
RIVALS = {
    "SPARSE_SCHUR": {"linear_solver_type": "SPARSE_SCHUR"},
    "SPARSE_SCHUR unscaled": {"linear_solver_type": "SPARSE_SCHUR", "jacobi_scaling": False},
    "DENSE_SCHUR": {
        "linear_solver_type": "DENSE_SCHUR",
        "dense_linear_algebra_library_type": "LAPACK",
    },
}
DENSE_UPTO = 330


# --- the problem, ours and theirs -------------------------------------------------------------


def simulated(images: int) -> Block:
    """The block that both sides adjust."""
    camera = CAMLIGHT.with_values(k3=0.0, p1=0.0, p2=0.0)
    block = corridor_block(
        images=images, camera=camera, control=0, check=0, lever_arm=(0.0, 0.0, 0.0), seed=1,
        start_error=(0.3, 0.003, 0.3),
    )  # fmt: skip
    block = add_noise(block, tie_px=TIE_SIGMA, gnss_m=GNSS_SIGMA)
    block.sigma["tie_px"] = 1.0
    block.sigma["gnss_m"] = np.array(GNSS_SIGMA) / TIE_SIGMA
    return block


def our_problem(block: Block):
    return make_problem(block, camera=FREE, lever_arm="fixed")


def our_solve(problem, threads: int = 1):
    return solve(Normal(problem, Loss(), threads=threads))


def write_colmap(problem, folder: Path) -> None:
    """COLMAP's binary model of a problem at its start, images and points in our order.

    Source: colmap/doc/format.rst. Pixels keep our origin: nothing here looks at a picture.
    """
    state, count = problem.start, problem.image_count
    (camera,) = problem.block.cameras.values()
    radial = [camera[name] for name in FREE.split(",")]
    head = struct.pack("<QIiQQ5d", 1, 1, 3, camera.width, camera.height, *radial)
    (folder / "cameras.bin").write_bytes(head)

    rays = np.diff(problem.ptr)
    point = np.repeat(np.arange(len(rays)), rays)
    by_image = np.argsort(problem.img, kind="stable")
    first = np.searchsorted(problem.img[by_image], np.arange(count + 1))
    place = np.empty(len(point), dtype=np.int64)
    place[by_image] = np.arange(len(point)) - first[problem.img[by_image]]

    seen = np.empty(len(point), dtype=[("xy", "<f8", 2), ("point", "<u8")])
    seen["xy"], seen["point"] = problem.xy[by_image], point[by_image] + 1
    rotation = quaternion_from_rotation(state.rotation)
    translation = -np.einsum("nij,nj->ni", state.rotation, state.centre)
    with open(folder / "images.bin", "wb") as file:
        file.write(struct.pack("<Q", count))
        for n in range(count):
            rows = seen[first[n] : first[n + 1]]
            file.write(struct.pack("<I7dI", n + 1, *rotation[n], *translation[n], 1))
            file.write(b"%d\0" % n + struct.pack("<Q", len(rows)) + rows.tobytes())

    track = np.column_stack([problem.img + 1, place]).astype("<i4")
    with open(folder / "points3D.bin", "wb") as file:
        file.write(struct.pack("<Q", len(rays)))
        for n, xyz in enumerate(state.points):
            rows = track[problem.ptr[n] : problem.ptr[n + 1]]
            file.write(struct.pack("<Q3d3BdQ", n + 1, *xyz, 0, 0, 0, 0.0, len(rows)))
            file.write(rows.tobytes())


class Ceres:
    """The same problem, built by COLMAP for Ceres; it can be solved once."""

    def __init__(self, problem):
        import pycolmap
        import pycolmap.cost_functions

        with tempfile.TemporaryDirectory() as folder:
            write_colmap(problem, Path(folder))
            self.model = pycolmap.Reconstruction(folder)
        options = pycolmap.BundleAdjustmentOptions()
        options.refine_principal_point = True
        options.min_track_length = 0
        options.ceres.loss_function_type = pycolmap.LossFunctionType.TRIVIAL
        config = pycolmap.BundleAdjustmentConfig()
        for image in self.model.images:
            config.add_image(image)
        self.adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, self.model)
        self.problem = self.adjuster.problem
        blocks = self.problem.num_parameter_blocks()
        self.priors = [
            pycolmap.cost_functions.AbsolutePosePositionPriorCost(np.diag(1 / weight), given)
            for weight, given in zip(problem.gnss_weight, problem.gnss_given, strict=True)
        ]
        for image, prior in zip(problem.gnss_image, self.priors, strict=True):
            pose = self.model.images[int(image) + 1].frame.rig_from_world.params
            self.problem.add_residual_block(prior, None, [pose])
        residuals = 2 * len(problem.img) + 3 * len(problem.gnss_image)
        if self.problem.num_residuals() != residuals:
            raise SystemExit("COLMAP left observations out: the problems are not the same")
        if self.problem.num_parameter_blocks() != blocks:
            raise SystemExit("COLMAP copied the poses: the position priors do not bind them")

    def solve(self, choice: dict):
        """Summary of Ceres."""
        import pyceres

        options = pyceres.SolverOptions()
        options.num_threads = 1
        options.initial_trust_region_radius = 1e10
        options.use_nonmonotonic_steps = False
        options.function_tolerance = 1e-6
        options.gradient_tolerance = options.parameter_tolerance = 0.0
        options.logging_type = pyceres.LoggingType.SILENT
        options.sparse_linear_algebra_library_type = (
            pyceres.SparseLinearAlgebraLibraryType.SUITE_SPARSE
        )
        for name, value in choice.items():
            if isinstance(value, str):
                value = type(getattr(options, name)).__members__[value]
            setattr(options, name, value)
        summary = pyceres.SolverSummary()
        pyceres.solve(options, self.problem, summary)
        if not summary.IsSolutionUsable():
            raise SystemExit(f"Ceres failed: {summary.message}")
        return summary


# --- measurements -------------------------------------------------------------------------------


def timed(work: Callable):
    """What the work returns, its CPU seconds and its wall seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, time.process_time() - cpu, time.perf_counter() - wall


def compare(problem, repeats: int) -> dict:
    """Both sides in turn, Ceres with the options that are the fastest at this size."""
    tried = {}
    for name, choice in RIVALS.items():
        if problem.image_count <= DENSE_UPTO or not name.startswith("DENSE"):
            ceres = Ceres(problem)
            tried[name] = timed(lambda c=ceres, o=choice: c.solve(o))[1]
            del ceres
    rival = min(tried, key=tried.get)
    ours, theirs, bare, built = [], [], [], []
    for _ in range(repeats):
        solution, cpu, _ = timed(lambda: our_solve(problem))
        ours.append(cpu)
        ceres, cpu, _ = timed(lambda: Ceres(problem))
        built.append(cpu)
        summary, cpu, _ = timed(lambda c=ceres: c.solve(RIVALS[rival]))
        theirs.append(cpu)
        bare.append(cpu * summary.minimizer_time_in_seconds / summary.total_time_in_seconds)
        del ceres
    ratio = [b / a for a, b in zip(ours, theirs, strict=True)]
    report = summary.FullReport()
    library = "Dense" if rival.startswith("DENSE") else "Sparse"
    return {
        "ours_s": statistics.median(ours),
        "ceres_s": statistics.median(theirs),
        "ceres_built_s": statistics.median(built),
        "ratio": statistics.median(ratio),
        "ratio_range": [min(ratio), max(ratio)],
        "ratio_without_preprocessor": statistics.median(
            b / a for a, b in zip(ours, bare, strict=True)
        ),
        "steps": solution.iterations,
        "ceres_steps": summary.num_successful_steps + summary.num_unsuccessful_steps,
        "cost": float(solution.cost),
        "ceres_cost": summary.final_cost,
        "cost_differs": abs(summary.final_cost / solution.cost - 1),
        "ceres_solver": rival,
        "ceres_tried_s": tried,
        "ceres_version": report.split("(v ")[1].splitlines()[0].rstrip(")") + ")",
        "ceres_library": stated(report, f"{library} linear algebra library"),
        "ceres_order": stated(report, "Linear solver ordering").split()[-1],
        "runs": {"ours_s": ours, "ceres_s": theirs},
    }


def stated(report: str, name: str) -> str:
    """What Ceres' full report says after a name."""
    (found,) = (row for row in report.splitlines() if row.startswith(name))
    return found.removeprefix(name).strip()


def alone(problem, repeats: int) -> dict:
    """Our side only."""
    runs = [timed(lambda: our_solve(problem)) for _ in range(repeats)]
    return {
        "ours_s": statistics.median(cpu for _, cpu, _ in runs),
        "steps": runs[0][0].iterations,
        "cost": float(runs[0][0].cost),
        "runs": {"ours_s": [cpu for _, cpu, _ in runs]},
    }


def two_threads(problem, repeats: int) -> dict:
    """Wall time with one thread over that with two, in turn."""
    ratio = []
    for _ in range(repeats):
        one, two = (timed(lambda n=n: our_solve(problem, n))[2] for n in (1, 2))
        ratio.append(one / two)
    return {
        "two_threads": statistics.median(ratio),
        "two_threads_range": [min(ratio), max(ratio)],
    }


def covariance(problem, iteration_s: float) -> dict:
    """CPU time of camera and ten poses, once factorised, and of every pose and point.

    Over that of one iteration.
    """
    normal = Normal(problem, Loss())
    state = solve(normal).state
    some = np.linspace(0, problem.image_count - 1, 10).astype(int)

    def wanted(known: Covariance) -> None:
        with threadpool_limits(1):
            assert known.shared is not None
            known.poses(some)

    def every(known: Covariance) -> None:
        assert len(known.each_pose) == problem.image_count
        assert len(known.each_point) == len(problem.ptr) - 1

    every(Covariance(LinearSystem(problem, state)))  # it compiles the kernel
    seconds, all_seconds = [], []
    for _ in range(3):
        known = Covariance(LinearSystem(problem, state))
        seconds.append(timed(lambda k=known: wanted(k))[1])
        all_seconds.append(timed(lambda k=known: every(k))[1])
    return {
        "covariance_s": statistics.median(seconds),
        "covariance_over_iteration": statistics.median(seconds) / iteration_s,
        "every_covariance_s": statistics.median(all_seconds),
        "every_covariance_over_iteration": statistics.median(all_seconds) / iteration_s,
    }


def everything_on(images: int) -> dict:
    """CPU time of one iteration with all on over that of the plain one, at the same state."""
    block = add_noise(
        corridor_block(images=images, seed=1), tie_px=TIE_SIGMA, mark_px=0.5, gnss_m=GNSS_SIGMA
    )
    plain = Normal(
        make_problem(block, camera="fraser8", lever_arm="fixed", control=[]),
        Loss(),
    )
    full = Normal(
        make_problem(block, camera="fraser8", lever_arm="free", effects=["rolling_shutter"]),
        Loss(LOSSES["huber"], 2.0),
    )

    def iteration(normal: Normal, near) -> None:
        p = normal.problem
        normal.assemble(p.start, 1e-6, near)
        normal.factor()
        normal.substitute(p.start, 1e-6, np.zeros((p.image_count, p.d)), np.zeros(p.shared_count))

    seconds = {}
    with threadpool_limits(1):
        # As between two steps of the solver, which knows the rows of the last one.
        near = {normal: normal.modelled_at(normal.problem.start) for normal in (plain, full)}
        for normal in (plain, full):
            iteration(normal, near[normal])
        for _ in range(5):
            for name, normal in (("plain", plain), ("full", full)):
                cpu = timed(lambda n=normal: iteration(n, near[n]))[1]
                seconds.setdefault(name, []).append(cpu)
    ratio = [b / a for a, b in zip(seconds["plain"], seconds["full"], strict=True)]
    return {
        "images": images,
        "plain_s": statistics.median(seconds["plain"]),
        "full_s": statistics.median(seconds["full"]),
        "ratio": statistics.median(ratio),
        "ratio_range": [min(ratio), max(ratio)],
    }


# Linux hands the peak of the parent down through ru_maxrss; VmHWM is the process' own.
_ADJUST = """
import sys
from pathlib import Path
import corridor
block = corridor.read(sys.argv[1])
adjustment = corridor.adjust(block, camera=sys.argv[2], lever_arm="fixed")
assert adjustment.converged
status = Path("/proc/self/status")
if status.exists():
    lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
    print(int(lines["VmHWM"].split()[0]) / 1024)
else:
    import resource
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
"""


def peak_memory(block: Block) -> float | None:
    """MB that a fresh process needs at most to read the block and adjust it; None on Windows."""
    if sys.platform == "win32":
        return None
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder) / "block"
        block.write(where, form="parquet")
        done = subprocess.run(
            [sys.executable, "-c", _ADJUST, str(where), FREE],
            capture_output=True,
            text=True,
            check=True,
        )
    return float(done.stdout.split()[-1])


def growth(rows: list[dict]) -> float | None:
    """Slope of log CPU time over log images."""
    if len(rows) < 2:
        return None
    images, seconds = ([row[key] for row in rows] for key in ("images", "ours_s"))
    return float(np.polyfit(np.log(images), np.log(seconds), 1)[0])


# --- report -------------------------------------------------------------------------------------


def machine() -> dict:
    versions = {name: importlib.metadata.version(name) for name in ("numba", "pycolmap", "pyceres")}
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    system = f"{platform.system()} {platform.machine()}"
    return {"versions": versions, "cores": os.cpu_count(), "system": system, "load": load}


def verdict(needs: float, has: float, most: bool = False, digits: int = 1) -> str:
    """`most`: the need is an upper limit."""
    holds = has <= needs if most else has >= needs
    words = "at most" if most else "needs"
    return f"{words} {needs:g}, has {has:.{digits}f}: {'pass' if holds else 'SHORT'}"


HEAD = (
    f"{'':>6} {'observ-':>9} {'steps':>6} {'CPU seconds':>15} {'times less CPU':>17} {'no':>5} "
    f"{'cost':>8}\n"
    f"{'images':>6} {'ations':>9} {'us  C':>6} {'us':>7} {'Ceres':>7} {'median (range)':>17} "
    f"{'prep':>5} {'differs':>8}"
)


def line(row: dict) -> str:
    text = f"{row['images']:6d} {row['observations']:9,d} {row['steps']:>3d}"
    if "ratio" not in row:
        return f"{text} {'-':>2} {row['ours_s']:7.3f} {'-':>7}"
    span = f"{row['ratio']:.1f} ({row['ratio_range'][0]:.1f}-{row['ratio_range'][1]:.1f})"
    text += f" {row['ceres_steps']:2d} {row['ours_s']:7.3f} {row['ceres_s']:7.3f} {span:>17} "
    text += f"{row['ratio_without_preprocessor']:5.1f} {row['cost_differs']:8.0e}"
    needs = NEEDS.get(row["images"])
    return f"{text}  {verdict(needs, row['ratio'])}" if needs else text


def measure(images: int) -> dict:
    """One row of the report."""
    began = time.perf_counter()
    block = simulated(images)
    problem, built, _ = timed(lambda: our_problem(block))
    repeats = 3 if images <= OFTEN_UPTO else 2
    row = {"images": images, "observations": len(problem.img), "ours_built_s": built}
    if images <= CERES_UPTO:
        row |= compare(problem, repeats)
    else:
        row |= alone(problem, repeats)
    row |= two_threads(problem, repeats)
    row |= covariance(problem, row["ours_s"] / row["steps"])
    if images == max(SIZES):
        row["peak_mb"] = peak_memory(block)
    row["measured_in_s"] = time.perf_counter() - began
    return row


def summary(report: dict) -> list[str]:
    rows = report["sizes"]
    lines = []
    against = [row for row in rows if "ratio" in row]
    if against:
        worst = max(row["cost_differs"] for row in against)
        holds = "pass" if worst <= COST_DIFFERS else "SHORT"
        lines.append(f"cost equal within {COST_DIFFERS:g}: differs by {worst:.0e} at most: {holds}")
    if report["growth"] is not None:
        span = f"{rows[0]['images']} to {rows[-1]['images']} images"
        lines.append(f"growth exponent, {span}: {verdict(GROWTH, report['growth'], True, 2)}")
    for row in rows:
        name = f"{row['images']} images"
        low, high = row["two_threads_range"]
        text = f"two threads, {name}, wall ({low:.2f}-{high:.2f}): "
        if row["images"] >= TWO_FROM:
            lines.append(text + verdict(TWO_THREADS, row["two_threads"], digits=2))
        else:
            lines.append(f"{text}{row['two_threads']:.2f}")
    for row in rows:
        lines.append(
            f"covariance of camera and ten poses, {row['images']} images, in iterations: "
            + verdict(1.0, row["covariance_over_iteration"], True, 2)
        )
        lines.append(
            f"covariance of every pose and point, {row['images']} images, in iterations: "
            + verdict(EVERY_COVARIANCE, row["every_covariance_over_iteration"], True, 2)
        )
    full = report["everything_on"]
    low, high = full["ratio_range"]
    lines.append(
        f"control, lever arm, Huber, rolling shutter over plain, {full['images']} images "
        f"({low:.2f}-{high:.2f}):\n    {verdict(EVERYTHING, full['ratio'], True, 2)}"
    )
    for row in rows:
        if row.get("peak_mb"):
            words = f"peak memory in MB, {row['images']} images, read and adjusted: "
            lines.append(words + verdict(PEAK_MB, row["peak_mb"], True, 0))
    return lines


def counts(text: str) -> list[int]:
    try:
        sizes = sorted({int(part) for part in text.split(",")})
    except ValueError:
        sizes = [0]
    if sizes[0] < 10:
        raise argparse.ArgumentTypeError(f"{text!r} are not numbers of images, 10 at least each")
    return sizes


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--short", action="store_true", help="114 and 330 images only")
    parser.add_argument("--images", type=counts, help="sizes to measure instead: 114,1080")
    parser.add_argument("--json", type=Path, help="write all figures to this file as well")
    options = parser.parse_args()
    # BLAS inside the packages reads this when it is loaded.
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        import pyceres  # noqa: F401
        import pycolmap  # noqa: F401
    except ImportError as missing:
        print(
            f"{missing.name} is needed for this comparison: pip install -e .[bench]",
            file=sys.stderr,
        )
        return 2

    report = {"machine": machine(), "sizes": []}
    here = report["machine"]
    packages = ", ".join(f"{name} {number}" for name, number in here["versions"].items())
    print(f"{packages}; {here['system']}, {here['cores']} cores", end="")
    print(f", load {here['load']:.1f}" if here["load"] is not None else "")
    our_solve(our_problem(simulated(60)))
    print(HEAD, flush=True)
    for images in options.images or (SHORT if options.short else SIZES):
        row = measure(images)
        report["sizes"].append(row)
        print(line(row), flush=True)
    report["growth"] = growth(report["sizes"])
    report["everything_on"] = everything_on(min(OFTEN_UPTO, report["sizes"][-1]["images"]))
    print()
    versions = {row["ceres_version"] for row in report["sizes"] if "ceres_version" in row}
    print("\n".join(f"Ceres {version}" for version in versions))
    for row in report["sizes"]:
        if "ceres_solver" in row:
            tried = ", ".join(f"{name} {cpu:.2f}" for name, cpu in row["ceres_tried_s"].items())
            print(
                f"Ceres at {row['images']}: {row['ceres_solver']}, {row['ceres_library']}, "
                f"eliminated {row['ceres_order']}\n"
                f"    tried, CPU s: {tried}\n"
                f"    built, CPU s: {row['ceres_built_s']:.2f}, ours {row['ours_built_s']:.2f}"
            )
    print()
    print("\n".join(summary(report)))
    if options.json:
        options.json.write_text(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
