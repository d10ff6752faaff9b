"""Separations a second: this package, scipy's solve_ivp, and a plain C loop, in one process and interleaved.

    PYTHONPATH=tests python tests/benchmarks/simulator_peers.py

(a) the guided reference case of the truth set (no cant, delay, gravity, envelope) with scattered inputs; (b) the
reference case of the package with its 35 inputs: cants, delays, gravity, and the exits of four envelope points. The C
loop (guided_separation.c beside this file) does (a) only. That all agree to 1e-8 (with runs at tolerance 1e-12, in the
worst run and quantity) is asserted before anything is timed. One thread is timed by the processor time that it uses, so
that other work on the machine matters less; two threads against one by the clock.
"""

import ctypes
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

import numba
import numpy as np
import openturns as ot
from scipy.integrate import DOP853, solve_ivp
from separation_cases import truth_separation

from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.inputs import ParameterMap
from satsep_ot.model.separation_problem import SeparationProblem

SIZE, SCIPY_SIZE, REPETITIONS = 4000, 3, 9
MANY = 10  # times as many runs for two threads against one, so that their start does not count
AGREEMENT = 1e-8
# The loosest is taken that keeps the worst of the runs within 1e-8.
TOLERANCES = (1e-7, 5e-8, 2e-8, 1e-8, 5e-9, 2e-9, 1e-9)
SOURCE = Path(__file__).with_name("guided_separation.c")
BODY = (
    "mass", *(f"inertia.{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
    *(f"center_of_mass.{axis}" for axis in "xyz"),
)  # fmt: skip


def guided_case(size, seed=0):
    """Case (a): the separation and `size` parameter vectors scattered about it."""
    separation = truth_separation("reference", "guided")
    rng = np.random.default_rng(seed)
    rows = np.tile(separation.parameters(), (size, 1))
    for column, name in enumerate(separation.parameter_names()):
        if "center_of_mass" in name:
            rows[:, column] += 3e-3 * rng.standard_normal(size)
        elif name.startswith("rates"):
            rows[:, column] += math.radians(0.2) * rng.standard_normal(size)
        elif name.endswith(("mass", "xx", "yy", "zz", "stiffness", "stroke", "deformation")):
            rows[:, column] *= 1.0 + 0.01 * rng.standard_normal(size)
    return separation, rows


def reference_case(size, seed=0):
    """Case (b): the separation and `size` parameter vectors from the distribution of its 35 inputs."""
    problem = SeparationProblem("reference")
    ot.RandomGenerator.SetSeed(seed)
    sample = np.asarray(problem.getDistribution().getSample(size))
    separation = problem.getCase().separation
    return separation, ParameterMap(problem.getCase().inputs, separation).parameters(sample)


def summary(axial, lateral, rates, releases, exits):
    """What is compared, one row a run: velocities over their size, rates over theirs [rad/s], times and clearances."""
    speed, turning = np.hypot(axial, lateral), np.maximum(np.linalg.norm(rates, axis=1), 1e-3)
    return {
        "velocity": (np.stack([axial, lateral], axis=1), speed),
        "rates": (rates, turning),
        "release times": (releases, releases.max(axis=1)),
        "exit clearances": (exits, np.abs(exits).max(axis=1, initial=0.01)),
    }


def our_summary(separation, rows, tolerance=1e-8):
    """The summary of this package's runs."""
    outcome = simulate(separation, rows, tolerance=tolerance)
    assert (outcome.status == 0).all()
    rates = np.radians(np.stack([outcome.quantity(f"rate_{axis}") for axis in "xyz"], axis=1))
    exits = [1e-3 * outcome.quantity(f"exit_clearance_{i + 1}") for i in range(len(separation.recess_points()))]
    return summary(
        outcome.quantity("axial_velocity"), outcome.quantity("lateral_velocity"), rates, outcome.release_times,
        np.array(exits).reshape(-1, len(rows)).T,
    )  # fmt: skip


def largest_difference(one, other):
    """The largest relative difference of two summaries."""
    return max(float((np.abs(one[name][0] - other[name][0]) / one[name][1][:, None]).max(initial=0.0)) for name in one)


def rotation(q):
    """The matrix that turns body into inertial components."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def cross(a, b):
    """a x b; numpy's own takes ten times as long for three numbers."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def moment(arms, forces):
    """The sum of arm x force over springs, from the one product of both."""
    g = arms.T @ forces
    return np.array([g[1, 2] - g[2, 1], g[2, 0] - g[0, 2], g[0, 1] - g[1, 0]])


def quaternion_rate(q, o):
    """q (x) [0, o] / 2."""
    w, x, y, z = q
    return 0.5 * np.array(
        [
            -x * o[0] - y * o[1] - z * o[2], w * o[0] + y * o[2] - z * o[1], w * o[1] + z * o[0] - x * o[2],
            w * o[2] + x * o[1] - y * o[0],
        ]
    )  # fmt: skip


def scipy_run(separation, row, rtol=1e-8, atol=1e-12):
    """One run by solve_ivp: relative position and velocity, rates and quaternions, in inertial axes.

    It starts anew where a spring starts to push or is released, as the force jumps there. It does guided springs and
    struts, gravity and its torque, but no mounting error.
    """
    value = dict(zip(separation.parameter_names(), row, strict=True))
    mass, inertia, inverse, cg = [], [], [], []
    for body in ("platform", "satellite"):
        m, xx, yy, zz, xy, xz, yz, *center = (value[f"{body}.{name}"] for name in BODY)
        mass.append(m)
        inertia.append(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        inverse.append(np.linalg.inv(inertia[-1]))
        cg.append(np.array(center))
    springs = range(len(separation.springs))
    angle, radius, stiffness, deformation, stroke, cant, delay = (
        np.array([value[f"springs[{i}].{name}"] for i in springs])
        for name in ("angle", "radius", "stiffness", "deformation", "stroke", "cant", "delay")
    )
    release_stroke, flat = np.minimum(stroke, deformation), np.zeros(len(angle))
    seats = np.stack([radius * np.cos(angle), flat, radius * np.sin(angle)], axis=1)
    guides = np.stack([-np.sin(cant) * np.sin(angle), np.cos(cant), np.sin(cant) * np.cos(angle)], axis=1)
    stowed, strut = value["stowed_length"], separation.force_line == ForceLine.STRUT
    seats_1, seats_2 = seats + stowed * (np.array([0.0, 1.0, 0.0]) - guides) - cg[0], seats - cg[1]
    inverse_mass = 1.0 / mass[0] + 1.0 / mass[1]
    gravity = separation.orbit is not None
    mu, *orbit = separation.platform_orbit()
    points = separation.recess_points() - cg[1]
    active = delay <= 0.0

    def strokes(x):
        turn_1 = rotation(x[12:16])
        contacts = seats_2 @ rotation(x[16:20]).T + x[0:3]
        between = contacts - seats_1 @ turn_1.T
        if strut:
            length = np.sqrt((between * between).sum(axis=1))
            return length - stowed, contacts, between / length[:, None]
        directions = guides @ turn_1.T
        return (between * directions).sum(axis=1), contacts, directions

    def slope(t, x):
        turn_1, turn_2, rates_1, rates_2 = rotation(x[12:16]), rotation(x[16:20]), x[6:9], x[9:12]
        s, contacts, directions = strokes(x)
        forces = (stiffness * (deformation - s) * active)[:, None] * directions
        acceleration = inverse_mass * forces.sum(axis=0)
        moment_1, moment_2 = -turn_1.T @ moment(contacts, forces), turn_2.T @ moment(contacts - x[0:3], forces)
        k = np.empty(x.size)
        if gravity:
            k[20:23], k[23:26] = x[23:26], -mu / (x[20:23] @ x[20:23]) ** 1.5 * x[20:23]
            there = x[20:23] + x[0:3]
            acceleration = acceleration - mu / (there @ there) ** 1.5 * there - k[23:26]
            if separation.gradient_torque:
                up_1, up_2 = turn_1.T @ x[20:23], turn_2.T @ there
                moment_1 = moment_1 + 3.0 * mu / (up_1 @ up_1) ** 2.5 * cross(up_1, inertia[0] @ up_1)
                moment_2 = moment_2 + 3.0 * mu / (up_2 @ up_2) ** 2.5 * cross(up_2, inertia[1] @ up_2)
        k[0:3], k[3:6] = x[3:6], acceleration
        k[6:9] = inverse[0] @ (moment_1 - cross(rates_1, inertia[0] @ rates_1))
        k[9:12] = inverse[1] @ (moment_2 - cross(rates_2, inertia[1] @ rates_2))
        k[12:16], k[16:20] = quaternion_rate(x[12:16], rates_1), quaternion_rate(x[16:20], rates_2)
        return k

    def to_release(t, x):
        return (strokes(x)[0] - release_stroke)[active].max(initial=-1.0)

    def to_exit(i):
        def height(t, x):
            return (rotation(x[12:16]).T @ (x[0:3] + rotation(x[16:20]) @ points[i]))[1] - threshold

        height.direction = 1.0
        return height

    to_release.terminal, to_release.direction = True, 1.0
    turn, rates = rotation(separation.attitude), row[[separation.parameter_names().index(f"rates.{i}") for i in "xyz"]]
    arm = cg[1] - cg[0] + np.array([0.0, stowed, 0.0])
    x = np.concatenate([turn @ arm, turn @ cross(rates, arm), rates, rates, separation.attitude, separation.attitude])
    x, t = np.concatenate([x, orbit]) if gravity else x, 0.0
    options = {"method": "DOP853", "rtol": rtol, "atol": atol}
    releases, pending = np.full(len(angle), np.nan), ~active
    while np.isnan(releases).any():
        end = delay[pending].min(initial=10.0)
        part = solve_ivp(slope, (t, end), x, events=to_release, **options)
        t, x = part.t[-1], part.y[:, -1]
        if part.status == 1:
            spring = np.flatnonzero(active)[np.argmax((strokes(x)[0] - release_stroke)[active])]
            releases[spring], active[spring] = t, False
        else:
            started = pending & (delay <= t)
            active, pending = active | started, pending & ~started
    turn = rotation(x[12:16])
    velocity, rates = turn.T @ x[3:6], x[9:12]
    exits = np.empty(len(points))
    if len(points):
        threshold = value["recess_depth"] - cg[0][1]
        events = [to_exit(i) for i in range(len(points))]

        def all_out(t, x):
            return min(event(t, x) for event in events)

        all_out.terminal, all_out.direction = True, 1.0
        coast = solve_ivp(slope, (t, 10.0), x, events=[*events, all_out], **options)
        for i, found in enumerate(coast.y_events[:-1]):
            # The last exit ends the run: the event may be found there rather than before.
            y = (found if len(found) else coast.y_events[-1])[0]
            place = cg[0] + rotation(y[12:16]).T @ (y[0:3] + rotation(y[16:20]) @ points[i])
            exits[i] = value["recess_radius"] - math.hypot(place[0], place[2])
    return velocity[1], math.hypot(velocity[0], velocity[2]), rates, releases, exits


def scipy_summary(separation, rows, **options):
    """The summary of scipy's runs."""
    return summary(
        *(np.array(values) for values in zip(*(scipy_run(separation, row, **options) for row in rows), strict=True))
    )


def stages_source():
    """The stages of the eighth-order method as C statements, from scipy's coefficients."""

    def line(target, start, weights):
        terms = " + ".join(f"{float(w)!r} * k[{j}][n]" for j, w in enumerate(weights) if w != 0.0)
        return f"for (int n = 0; n < SIZE; n++) {target}[n] = {start}({terms});"

    lines = []
    for i in range(1, DOP853.n_stages):
        lines += [line("y", "x[n] + h * ", DOP853.A[i, :i]), f"slope(run, y, k[{i}]);"]
    lines.append(line("out", "x[n] + h * ", DOP853.B))
    sums = [
        " + ".join(f"{float(w)!r} * k[{j}][n]" for j, w in enumerate(weights[: DOP853.n_stages]) if w != 0.0)
        for weights in (DOP853.E5, DOP853.E3)
    ]
    lines.append(
        f"for (int n = 0; n < SIZE; n++) {{ e5 = ({sums[0]}) / scale[n]; e3 = ({sums[1]}) / scale[n]; "
        "fifth += e5 * e5; third += e3 * e3; }"
    )
    return "\n".join(lines) + "\n"


def compile_c(folder):
    """The C loop as a function of packed rows, spring number and tolerance; None where there is no compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return None
    folder = Path(folder)
    (folder / "stages.h").write_text(stages_source(), encoding="utf-8")
    library = folder / "guided_separation.so"
    subprocess.run(
        [compiler, "-O3", "-march=native", "-shared", "-fPIC", f"-I{folder}", "-o", library, SOURCE, "-lm"], check=True
    )
    function = ctypes.CDLL(str(library)).separate_all
    array = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    function.argtypes = [array, ctypes.c_size_t, ctypes.c_int, ctypes.c_double, array, array]
    function.restype = ctypes.c_long

    def run(packed, count, tolerance):
        motion, releases = np.empty((len(packed), 6)), np.empty((len(packed), count))
        slopes = function(packed, len(packed), count, tolerance, motion, releases)
        assert slopes > 0, "the C loop gave up on a run"
        return motion, releases, slopes

    return run


def packed_rows(separation, rows):
    """The parameter vectors as the C loop takes them."""
    names = separation.parameter_names()
    wanted = [f"{body}.{name}" for body in ("platform", "satellite") for name in BODY]
    wanted += [f"rates.{axis}" for axis in "xyz"]
    for i in range(len(separation.springs)):
        wanted += [f"springs[{i}].{name}" for name in ("angle", "radius", "stiffness", "deformation", "stroke")]
    return np.ascontiguousarray(rows[:, [names.index(name) for name in wanted]])


def c_summary(run, separation, rows, tolerance):
    """The summary of the C loop's runs."""
    motion, releases, _ = run(packed_rows(separation, rows), len(separation.springs), tolerance)
    return summary(
        motion[:, 1], np.hypot(motion[:, 0], motion[:, 2]), motion[:, 3:], releases, np.empty((len(rows), 0))
    )


def best_times(jobs, clock, repetitions=REPETITIONS):
    """The shortest time of each job by a clock, the jobs taken in turns."""
    best = dict.fromkeys(jobs, np.inf)
    for _ in range(repetitions):
        for name, job in jobs.items():
            start = clock()
            job()
            best[name] = min(best[name], clock() - start)
    return best


def loosest(error):
    """The loosest tolerance whose error is small enough, and that error."""
    for tolerance in TOLERANCES:
        difference = error(tolerance)
        if difference < AGREEMENT:
            return tolerance, difference
    raise AssertionError(f"an error of {difference} at a tolerance of {tolerance}")


def compare(label, separation, rows, run):
    """Assert that all agree, then print the speed of each."""
    exact, few = our_summary(separation, rows, 1e-12), rows[:SCIPY_SIZE]
    chosen = {
        "satsep-ot": loosest(lambda tolerance: largest_difference(our_summary(separation, rows, tolerance), exact)),
        "scipy": (1e-8, largest_difference(scipy_summary(separation, few), our_summary(separation, few, 1e-12))),
    }
    tolerance = chosen["satsep-ot"][0]
    jobs = {
        "satsep-ot": lambda: simulate(separation, rows, tolerance=tolerance),
        "scipy": lambda: scipy_summary(separation, few),
    }
    sizes = {"satsep-ot": len(rows), "scipy": SCIPY_SIZE, "C": len(rows)}
    if run is not None:
        packed, count = packed_rows(separation, rows), len(separation.springs)
        chosen["C"] = loosest(lambda tolerance: largest_difference(c_summary(run, separation, rows, tolerance), exact))
        jobs["C"] = lambda: run(packed, count, chosen["C"][0])
    assert chosen["scipy"][1] < AGREEMENT, chosen
    numba.set_num_threads(1)
    best = best_times(jobs, time.thread_time)
    rate = {name: sizes[name] / seconds for name, seconds in best.items()}
    print(f"{label}: {len(rows):,} runs ({SCIPY_SIZE} of scipy), one thread")
    for name, value in rate.items():
        ratio = "" if name == "satsep-ot" else f"; satsep-ot makes {rate['satsep-ot'] / value:,.3f} times as many"
        print(f"  {name:9s} {value:9,.0f} a second, tolerance {chosen[name][0]:g}, error {chosen[name][1]:.0e}{ratio}")
    if numba.config.NUMBA_NUM_THREADS > 1:
        many = np.tile(rows, (MANY, 1))
        best = best_times(
            {n: lambda n=n: on_threads(n, separation, many, tolerance) for n in (1, 2)}, time.perf_counter
        )
        print(f"  two threads make {best[1] / best[2]:.2f} times as many as one, of {len(many):,} runs")


def on_threads(threads, separation, rows, tolerance):
    """Our runs on so many threads."""
    numba.set_num_threads(threads)
    simulate(separation, rows, tolerance=tolerance)


def main():
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "numpy", "numba", "scipy"))
    print(f"{versions}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; seed 0")
    with tempfile.TemporaryDirectory() as folder:
        run = compile_c(folder)
        if run is None:
            print("no C compiler (gcc or cc) was found: the C loop is left out")
        compare("(a) guided reference of the truth set", *guided_case(SIZE), run)
        compare("(b) reference case, 35 inputs (the C loop does not do it)", *reference_case(SIZE), None)


if __name__ == "__main__":
    main()
