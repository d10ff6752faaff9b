"""How long commands take to end after SIGINT at random moments on a busy machine, and what they leave.

    python tests/benchmarks/interrupt_times.py [share]

Two endless loops run beside. A trial starts a command in a process group of its own, sends SIGINT at a random moment
(uniform, seed 0) to the process alone (as `kill` does) and to its group (as a terminal does) in turn, and takes the
time until the process has ended. Each trial of `study` and `benchmark` continues where the last one was interrupted, so
that all that they do is met. Processes that a trial leaves are found by a variable in their environment. A share below
1 makes so much fewer trials. It takes some seven minutes.
"""

import collections
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

MARK = "SATSEP_INTERRUPT_TRIAL"
# Command, trials, latest moment of the signal [s].
COMMANDS = (
    (["benchmark", "--problems", "P1", "P4", "P2", "--methods", "SORM", "ActiveSubspace", "SubsetSampling", "FORM",
      "--repetitions", "10000", "--output", "all", "--resume"], 40, 6.0),
    # Tvedt's formula for 100 inputs holds the interpreter's lock for two thirds of the time.
    (["benchmark", "--problems", "P1", "--methods", "SORM", "--repetitions", "10000", "--output", "sorm", "--resume"],
     20, 8.0),
    (["study", "--runs", "200000", "--output", "study", "--resume"], 20, 8.0),
    (["study", "--runs", "10000000", "--workers", "2", "--output", "workers", "--resume"], 20, 8.0),
    (["simulate"], 20, 1.5),
    (["check", "reference"], 10, 2.5),
)  # fmt: skip


def left(mark):
    """Numbers of the processes, other than zombies, that have the mark in their environment."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}\0".encode() in (path / "environ").read_bytes() + b"\0":
                found.append(int(path.name))
        except OSError:
            continue
    return found


def trial(arguments, folder, moment, group, mark):
    """Seconds until the end, exit code, what was said, the last step, and the processes left at once and later."""
    with (folder / "said").open("w+b") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "satsep_ot", *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=said,
            env={**os.environ, MARK: mark}, start_new_session=True,
        )  # fmt: skip
        time.sleep(moment)
        ended = process.poll() is not None
        start = time.perf_counter()
        if not ended:
            (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
        try:
            code = process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            code = "never"
        taken = time.perf_counter() - start
        at_once = left(mark)
        limit = time.monotonic() + 5.0
        while left(mark) and time.monotonic() < limit:
            time.sleep(0.05)
        later = left(mark)
        for number in later:
            os.kill(number, signal.SIGKILL)
        said.seek(0)
        *steps, last = said.read().decode().splitlines() or [""]
    step = (steps[-1].partition("%")[2].strip() if steps else "") or "before the first step"
    return None if ended else (taken, code, last, step, len(at_once), len(later))


def main(share):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    python = f"Python {sys.version.split()[0]}"
    print(f"{versions}, {python}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before; seed 0", flush=True)
    draw = random.Random(0)
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        with tempfile.TemporaryDirectory() as folder:
            for arguments, number, latest in COMMANDS:
                show(arguments, number, latest, share, draw, Path(folder))
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
    print(f"load {os.getloadavg()[0]:.1f} at the end")


def show(arguments, number, latest, share, draw, folder):
    trials = max(round(share * number), 1)
    print(f"\n$ satsep-ot {' '.join(arguments)}")
    ends = [
        trial(arguments, folder, draw.uniform(0.05, latest), bool(index % 2), f"{os.getpid()}-{arguments[0]}-{index}")
        for index in range(trials)
    ]
    finished = ends.count(None)
    ends = [end for end in ends if end is not None]
    times = sorted(end[0] for end in ends)
    print(f"{len(ends)} trials, signal 0.05 to {latest:g} s after the start; {finished} more had finished before it")
    print(
        f"seconds from the signal to the end: median {times[len(times) // 2]:.3f}, 95 % below "
        f"{times[int(0.95 * (len(times) - 1))]:.3f}, longest {times[-1]:.3f}; beyond 1 s: {sum(t > 1.0 for t in times)}"
    )
    codes = collections.Counter(str(end[1]) for end in ends)
    print(f"exit codes: {', '.join(f'{code} in {count}' for code, count in codes.items())}")
    print(f"processes left at the end: {sum(end[4] for end in ends)}; 5 s later: {sum(end[5] for end in ends)}")
    for sentence, count in collections.Counter(end[2] for end in ends).most_common():
        print(f"said in {count}: {sentence}")
    steps = collections.Counter(end[3] for end in ends)
    print(f"interrupted in: {', '.join(f'{step} ({count})' for step, count in steps.most_common())}", flush=True)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 1.0)
