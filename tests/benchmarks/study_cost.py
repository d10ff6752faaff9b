"""Time, memory and files of `satsep-ot study` on the reference case, from a cold compile cache.

python tests/benchmarks/study_cost.py
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path


def main():
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"{versions}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    with tempfile.TemporaryDirectory() as directory:
        environment = {**os.environ, "NUMBA_CACHE_DIR": f"{directory}/cache"}
        command = [sys.executable, "-m", "satsep_ot", "study", "--output", f"{directory}/study"]
        start = time.perf_counter()
        subprocess.run(command, check=True, env=environment, capture_output=True)
        seconds = time.perf_counter() - start
        size = sum(path.stat().st_size for path in Path(directory, "study").rglob("*") if path.is_file())
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"satsep-ot study, seed 0, all methods: {seconds:.0f} s of the clock, {used.ru_utime:.0f} s of processor time,"
    )
    print(f"largest memory {used.ru_maxrss / 1024:.0f} MiB, results directory {size / 2**20:.0f} MiB;")
    print(f"load {os.getloadavg()[0]:.1f} at the end")


if __name__ == "__main__":
    main()
