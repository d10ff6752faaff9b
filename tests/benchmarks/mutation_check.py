"""Do the fast tests notice a wrong sign, bound or factor? Mutants of the simulator's kernels and of the estimator.

    python tests/benchmarks/mutation_check.py FOLDER [--seed 1] [--dynamics 50] [--methods 80]

Copies the last commit into FOLDER and records there once which test reaches which lines, and how long it takes. Then
it changes one operator or number at a time, at random places of all modules of these layers, runs the tests that reach
the line, the quickest first, and stops at the first that fails. Kernels run as plain Python in this first stage, so
that a mutant of them costs no compilation. What survives runs all fast tests of the files that reach its line, as they
are compiled. The results are kept in FOLDER: started again, it goes on where it was. A copy of a FOLDER that has its
record serves another seed.

    python tests/benchmarks/mutation_check.py FOLDER --survivors EARLIER --seed 1 --tests MODULE=TEST ...

makes the mutants that survived in the folder EARLIER in the last commit, and runs the tests of their module, compiled.
"""

import argparse
import ast
import contextlib
import importlib
import io
import json
import math
import os
import platform
import random
import re
import resource
import signal
import subprocess
import sys
import tarfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path

import coverage
import pytest

ROOT = Path(__file__).resolve().parents[2]
QUICK_TEST = 1.0  # s, while lines are recorded: longer ones are left to the second, compiled stage
QUICK_FILE = 8.0  # s for the tests of a file: those that come later are left to the second stage as well
# Seconds for the tests of one mutant: of processor time, beside twice what they take without it, and of any time. A
# mutant that never ends is noticed.
PATIENCE, WAIT = 150, 1800.0
# How many mutants of each layer.
LAYERS = {"dynamics": 50, "methods": 80}
# (file, line as it is, line as it was made) -> why no test can tell the two apart.
EQUIVALENT = {
    (
        "methods/polynomials/prediction.py",
        "matrices = np.zeros((dimension, degree + 1, degree + 1))",
        "matrices = np.zeros((dimension, degree + 1, degree + 2))",
    ): "a column of zeros more, for a power that no polynomial has and no one reads",
    (
        "methods/subspaces/gradients.py",
        "ahead = self.evaluate((some[:, None, :] + shifts).reshape(-1, d)).reshape(len(some), d, -1)",
        "ahead = self.evaluate((some[:, None, :] + shifts).reshape(-1, d)).reshape(len(some), d, -2)",
    ): "numpy takes every negative number for the one that is left",
    (
        "methods/reliability/proposal.py",
        "pool = Pool.draw(mixture, _POOL_SIZE // 20, generator)",
        "pool = Pool.draw(mixture, _POOL_SIZE // 21, generator)",
    ): "how many points tell the share of a mode, for which some fewer do as well",
    (
        "methods/polynomials/basis.py",
        "block = max(256, BLOCK_NUMBERS // self.size)",
        "block = max(257, BLOCK_NUMBERS // self.size)",
    ): "how many points are worked on at once, which changes time alone",
    (
        "methods/subspaces/estimation.py",
        "np.where(possible, square / np.where(possible, lower, 1.0), upper),",
        "np.where(possible, square / np.where(possible, lower, 0.5), upper),",
    ): "a number that is only not to be 0",
    (
        "methods/reliability/surrogate.py",
        "directions = linear.coefficients[1:, None] / max(np.linalg.norm(linear.coefficients[1:]), 1e-300)",
        "directions = linear.coefficients[1:, None] / max(np.linalg.norm(linear.coefficients[1:]), 5e-301)",
    ): "a number that is only not to be 0",
    (
        "methods/polynomials/fit.py",
        "lost = slack < LOST_SLACK",
        "lost = slack <= LOST_SLACK",
    ): "they differ where rounding decides anyhow",
    (
        "methods/reliability/mixture.py",
        "lower, upper = (lower, middle) if variation(middle) <= 2.5 else (middle, upper)",
        "lower, upper = (lower, middle) if variation(middle) < 2.5 else (middle, upper)",
    ): "they differ where rounding decides anyhow",
    (
        "dynamics/kernels/coast.py",
        "if square < smallest:",
        "if square <= smallest:",
    ): "of two places that are equally near, either is the answer",
    (
        "methods/reliability/surrogate.py",
        "return value, np.maximum(scale, 1e-12 * max(float(np.abs(value).max()), 1e-300))",
        "return value, np.maximum(scale, 1e-12 * max(float(np.abs(value).max()), 2e-300))",
    ): "a number that is only not to be 0",
    (
        "methods/polynomials/fit.py",
        "block = max(256, BLOCK_NUMBERS // width)",
        "block = max(257, BLOCK_NUMBERS // width)",
    ): "how many points are worked on at once, which changes time alone",
    (
        "methods/polynomials/distribution.py",
        "upper = probability > 0.5",
        "upper = probability > 0.25",
    ): "the tail that the root is looked for through, of which either has its digits between a quarter and a half",
    (
        "methods/polynomials/fit.py",
        "factor = np.zeros((1, 1))",
        "factor = np.zeros((1, 2))",
    ): "of this placeholder only the diagonal is looked at, and it is 0 either way",
    (
        "methods/subspaces/estimation.py",
        "ROWS_FOR_CHOLESKY = 4",
        "ROWS_FOR_CHOLESKY = 5",
    ): "from which size on the quicker of two ways is taken, which give the same",
    (
        "methods/subspaces/analysis.py",
        "gradients, bootstrap_size, max(largest, dimension or 0), scales, weights",
        "gradients, bootstrap_size, max(largest, dimension or 1), scales, weights",
    ): "the other number is never smaller than 1",
    **{
        ("methods/common/standard_space.py", "CHECK_LEVELS = (0.5, 0.84, 0.05)", f"CHECK_LEVELS = {levels}"): (
            "one of the points at which a transformation is checked, for which any other serves"
        )
        for levels in ("(0.5, 0.84, 0.1)", "(0.25, 0.84, 0.05)")
    },
    (
        "methods/subspaces/estimation.py",
        "block = max(1, 4_000_000 // (max(d, len(rows)) * d))",
        "block = max(1, 4_000_000 // (min(d, len(rows)) * d))",
    ): "how many replicates are worked on at once, which changes memory alone",
    (
        "methods/reliability/failure_modes.py",
        "_LARGEST_MIXTURE = 16",
        "_LARGEST_MIXTURE = 17",
    ): "how many normal densities a mode may have, for which one more does as well",
}

OPERATORS = {
    ast.Add: ("+", ["-"]),
    ast.Sub: ("-", ["+"]),
    ast.Mult: ("*", ["/"]),
    ast.Div: ("/", ["*"]),
    ast.Lt: ("<", ["<=", ">"]),
    ast.LtE: ("<=", ["<", ">="]),
    ast.Gt: (">", [">=", "<"]),
    ast.GtE: (">=", [">", "<="]),
    ast.Eq: ("==", ["!="]),
    ast.NotEq: ("!=", ["=="]),
    ast.And: ("and", ["or"]),
    ast.Or: ("or", ["and"]),
}
OPPOSITES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}


class Places(ast.NodeVisitor):
    """Every (start, end, replacements) in a text at which something can be made wrong."""

    def __init__(self, text):
        self.text, self.found = text, []
        self.lines = [0]
        for line in text.splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(line.encode()))
        self.bytes = text.encode()
        self.visit(ast.parse(text))

    def offset(self, line, column):
        return self.lines[line - 1] + column

    def between(self, left, right, operator):
        """The operator between two nodes."""
        symbol, others = OPERATORS[type(operator)]
        start = self.offset(left.end_lineno, left.end_col_offset)
        end = self.offset(right.lineno, right.col_offset)
        at = self.bytes.find(symbol.encode(), start, end)
        if at >= 0:
            self.found.append((at, at + len(symbol), others))

    def visit_BinOp(self, node):
        if type(node.op) in OPERATORS:
            self.between(node.left, node.right, node.op)
        self.generic_visit(node)

    def visit_AugAssign(self, node):
        if type(node.op) in OPERATORS:
            self.between(node.target, node.value, node.op)
        self.visit(node.value)

    def visit_Compare(self, node):
        operands = [node.left, *node.comparators]
        for left, right, operator in zip(operands, operands[1:], node.ops, strict=False):
            if type(operator) in OPERATORS:
                self.between(left, right, operator)
        self.generic_visit(node)

    def visit_BoolOp(self, node):
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.between(left, right, node.op)
        self.generic_visit(node)

    def visit_UnaryOp(self, node):
        start = self.offset(node.lineno, node.col_offset)
        if isinstance(node.op, ast.USub):
            self.found.append((start, start + 1, [""]))
        elif isinstance(node.op, ast.Not):
            self.found.append((start, start + 3, [""]))
        self.generic_visit(node)

    def visit_Constant(self, node):
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            return
        start, end = self.offset(node.lineno, node.col_offset), self.offset(node.end_lineno, node.end_col_offset)
        value = node.value
        others = [value + 1] if isinstance(value, int) else [1.0] if value == 0.0 else [2.0 * value, 0.5 * value]
        self.found.append((start, end, [repr(other) for other in others]))

    def visit_Name(self, node):
        if node.id in OPPOSITES and isinstance(node.ctx, ast.Load):
            start = self.offset(node.lineno, node.col_offset)
            self.found.append((start, start + len(node.id), [OPPOSITES[node.id]]))

    def visit_Attribute(self, node):
        if node.attr in OPPOSITES:
            end = self.offset(node.end_lineno, node.end_col_offset)
            self.found.append((end - len(node.attr), end, [OPPOSITES[node.attr]]))
        self.visit(node.value)

    def visit_FunctionDef(self, node):
        # No decorators, no annotations; a message may say what it likes.
        if node.name != "__repr__":
            for default in [*node.args.defaults, *filter(None, node.args.kw_defaults)]:
                self.visit(default)
            for statement in node.body:
                self.visit(statement)

    def visit_AnnAssign(self, node):
        if node.value is not None:
            self.visit(node.value)

    def visit_JoinedStr(self, node):
        pass

    visit_Raise = visit_Assert = visit_Import = visit_ImportFrom = visit_JoinedStr


def modules(folder, layer):
    """The modules of a layer, from the folder of the repository on."""
    return sorted(str(path.relative_to(folder)) for path in (folder / "satsep_ot" / layer).rglob("*.py"))


def mutants(folder, numbers, seed):
    """The mutants, in random order: file, place, what is put there, and the line before and after."""
    generator, chosen = random.Random(seed), []
    for layer in LAYERS:
        places = []
        for path in modules(folder, layer):
            text = (folder / path).read_text(encoding="utf-8")
            places += [(path, place) for place in Places(text).found]
        for path, (start, end, others) in generator.sample(places, numbers[layer]):
            content = (folder / path).read_bytes()
            put = generator.choice(others)
            changed = content[:start] + put.encode() + content[end:]
            number = content[:start].count(b"\n")
            before, after = (text.splitlines()[number].decode().strip() for text in (content, changed))
            chosen.append(dict(path=path, line=number + 1, start=start, end=end, put=put, before=before, after=after))
    generator.shuffle(chosen)
    return chosen


class Order:
    """A plug-in of pytest: runs `tests`, the quickest first, and ends those that take long.

    Parameters
    ----------
    durations : dict, optional
        Seconds of each test. Those that are not named, or that take long, are left out; all are run by default.
    limit : float, optional
        Seconds after which a test is ended.
    first : str, optional
        A test that comes before all others.
    record : coverage.Coverage, optional
        Records the lines of a test under its name, those of collecting and preparing it under that of its file.
    """

    def __init__(self, durations=None, limit=None, first=None, record=None):
        self.durations, self.first, self.record, self.measured, self.failed = durations, first, record, {}, []
        self.limit = limit or (QUICK_TEST if durations is None else 10.0 * QUICK_TEST)

    def pytest_collectreport(self, report):
        if report.failed:
            self.failed.append(f"{report.nodeid} cannot be collected")

    def pytest_collection_modifyitems(self, items):
        # One that waits for threads of plain Python cannot be ended.
        items[:] = [item for item in items if "threads" not in item.name]
        if self.durations is not None:
            items[:] = [item for item in items if self.durations.get(item.nodeid, math.inf) < QUICK_TEST]
            items.sort(key=lambda item: (item.nodeid != self.first, self.durations[item.nodeid]))

    def _limit(self):
        left = QUICK_FILE - sum(self.measured.values()) if self.record else math.inf
        return min(self.limit, max(left, 0.01))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item):
        with ended_after(self._limit()):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item):
        start = time.process_time()
        if self.record:
            self.record.switch_context(item.nodeid)
        try:
            with ended_after(self._limit()):
                return (yield)
        finally:
            if self.record:
                self.record.switch_context(item.nodeid.split("::")[0])
            self.measured[item.nodeid] = time.process_time() - start

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.failed.append(report.nodeid)


class TooSlow(BaseException):
    """No Exception: hypothesis would take it for a counterexample, and look for a simpler one."""


@contextlib.contextmanager
def ended_after(limit):
    """End what takes more processor time [s]: other programs may slow this one down."""
    signal.signal(signal.SIGPROF, end_test)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        yield
    finally:
        # First this: one that comes at the last moment would end pytest.
        signal.signal(signal.SIGPROF, signal.SIG_IGN)
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def end_test(number, frame):
    while frame:
        if Path(frame.f_code.co_filename).is_relative_to(Path(coverage.__file__).parent):
            # The record would stay locked.
            signal.setitimer(signal.ITIMER_PROF, 0.01)
            return
        frame = frame.f_back
    raise TooSlow


def test_files(folder):
    """The files of tests, but for those of whole studies and of the command."""
    files = sorted((folder / "tests").glob("test_*.py"))
    studies = re.compile(r"^from satsep_ot(\.studies| import cli)", re.M)
    return [f"tests/{file.name}" for file in files if not studies.search(file.read_text(encoding="utf-8"))]


def simulator_tests(folder):
    """The files of tests that import a module of the simulator."""
    simulator = re.compile(r"^from satsep_ot\.dynamics", re.M)
    return [file for file in test_files(folder) if simulator.search((folder / file).read_text(encoding="utf-8"))]


def in_child(folder, job, patience, name="job"):
    """What a job returns that runs in a copy of this process; None where it computes for too long or dies."""
    answer = folder / f"{name}.json"
    answer.unlink(missing_ok=True)
    child = os.fork()
    if child == 0:
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CPU, (patience, patience))
            os.chdir(folder)
            sys.path[:0] = [str(folder), str(folder / "tests")]
            with open(folder / f"{name}.out", "w") as output:
                os.dup2(output.fileno(), 1)
                os.dup2(output.fileno(), 2)
            answer.write_text(json.dumps(job()))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)
    deadline = time.monotonic() + WAIT
    while os.waitpid(child, os.WNOHANG)[0] == 0:
        if time.monotonic() > deadline:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(0.05)
    return json.loads(answer.read_text()) if answer.exists() else None


def run_tests(files, plugin, *options):
    # Plain Python warns of the divisions by zero that compiled code makes without a word.
    common = [
        "-q",
        "-p",
        "no:cacheprovider",
        "-m",
        "not slow",
        "--assert=plain",
        # An interruption may leave a place without a line number, on which pytest's own tracebacks fail.
        "--tb=native",
        "--hypothesis-seed=0",
        "-W",
        "ignore::RuntimeWarning",
    ]
    pytest.main([*common, *options, *files], plugins=[plugin])
    package = sys.modules.get("satsep_ot")
    assert package is None or Path(package.__file__).is_relative_to(Path.cwd()), package.__file__


def prepare(folder):
    """The last commit as a copy."""
    if (folder / "commit").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as packed:
        packed.extractall(folder, filter="data")
    commit = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True)
    (folder / "commit").write_text(commit.stdout.strip())


class Baseline:
    """What the tests do without a mutant: the processor time of each, and the lines that it reaches.

    A test that is ended, or fails since nothing is compiled, has an infinite duration; its lines are those until then.
    """

    def __init__(self, folder):
        self.folder, self.durations = folder, {}
        self.files = test_files(folder) + [path for layer in LAYERS for path in modules(folder, layer)]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for measured, failed in pool.map(self._measured, self.files):
                self.durations |= measured | dict.fromkeys(failed, math.inf)

    def _record(self, file):
        name = self.folder / f"{file.replace('/', '.')}.lines"
        return coverage.Coverage(data_file=str(name), source=[str(self.folder / "satsep_ot")], config_file=False)

    def _measured(self, file):
        """The durations of the tests of a file, and those that failed."""

        def measure():
            record = self._record(file)
            record.erase()
            record.start()
            record.switch_context(file)
            plugin = Order(record=record)
            run_tests([file], plugin)
            record.stop()
            record.save()
            return [plugin.measured, plugin.failed]

        name = file.replace("/", ".")
        kept = self.folder / f"{name}.json"
        if not kept.exists():
            if in_child(self.folder, measure, 1500, name) is None:
                raise SystemExit(f"{file} does not end, or crashes: see {name}.out in {self.folder}")
            measured, failed = json.loads(kept.read_text())
            print(f"{file}: {sum(measured.values()):.1f} s, {len(measured)} tests, not used {len(failed)}", flush=True)
        return json.loads(kept.read_text())

    def reaching(self, mutant):
        """The tests that reach the statement of a mutant; a file stands for all its tests."""
        text = (self.folder / mutant["path"]).read_text(encoding="utf-8")
        statement = set(statement_lines(text, mutant["line"]))
        found = set()
        for file in self.files:
            record = self._record(file)
            record.load()
            # In a copied FOLDER the paths are those of the first.
            paths = [path for path in record.get_data().measured_files() if path.endswith(f"/{mutant['path']}")]
            for path in paths:
                reached = record.get_data().contexts_by_lineno(path)
                found.update(*(reached.get(line, ()) for line in statement))
        return found

    def selected(self, reaching):
        """The durations of these tests, and of all tests of the files among them."""
        return {
            name: time
            for name, time in self.durations.items()
            if "::" in name and (name in reaching or name.split("::")[0] in reaching)
        }


def statement_lines(text, line):
    """The lines of the innermost statement around a line; of a compound one, those in front of its body."""
    best = range(line, line + 1)
    size = math.inf
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            lines = range(node.lineno, body[0].lineno if body else node.end_lineno + 1)
            if line in lines and len(lines) < size:
                best, size = lines, len(lines)
    return best


@contextlib.contextmanager
def applied(folder, mutant):
    """The mutant in its file, for a while."""
    path = folder / mutant["path"]
    content = path.read_bytes()
    path.write_bytes(content[: mutant["start"]] + mutant["put"].encode() + content[mutant["end"] :])
    try:
        yield
    finally:
        path.write_bytes(content)


def noticed(baseline, mutant, first):
    """The first test that fails, "" if none does."""
    folder, durations = baseline.folder, baseline.selected(baseline.reaching(mutant))
    quick = {name: time for name, time in durations.items() if time < QUICK_TEST}
    if not quick:
        return ""

    def check():
        plugin = Order(quick, first=first)
        run_tests(sorted({name.split("::")[0] for name in quick}), plugin, "-x")
        return plugin.failed[0] if plugin.failed else ""

    with applied(folder, mutant):
        answer = in_child(folder, check, PATIENCE + math.ceil(2.0 * sum(quick.values())))
    return "it never ends, or crashes" if answer is None else answer


def first_failure_compiled(folder, files):
    """The first that fails of all fast tests of these files, compiled, in a process of its own; "" if none does."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "not slow", *files]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    environment.pop("NUMBA_DISABLE_JIT", None)
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=3600)
    except subprocess.TimeoutExpired:
        return "it never ends"
    if done.returncode == 0:
        return ""
    return next((line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))), "it crashes")


def noticed_compiled(baseline, mutant):
    """The first test that fails, compiled, and not without the mutant; "" if none does."""
    files = sorted({name.split("::")[0] for name in baseline.reaching(mutant)})
    while files:
        with applied(baseline.folder, mutant):
            failure = first_failure_compiled(baseline.folder, files)
        failing = [file for file in files if f" {file}" in failure]
        if not failing or not first_failure_compiled(baseline.folder, failing):
            return failure
        files = files[files.index(failing[0]) + 1 :]
    return ""


def found_again(folder, mutant):
    """A mutant of an earlier commit in this one, by its line, which must be there once."""
    content = (folder / mutant["path"]).read_bytes()
    lines = [line.strip().decode() for line in content.splitlines()]
    if lines.count(mutant["before"]) != 1:
        raise SystemExit(
            f"{mutant['path']} has {lines.count(mutant['before'])} lines {mutant['before']}; it must have 1"
        )
    start = content.index(mutant["before"].encode())
    return mutant | dict(start=start, end=start + len(mutant["before"].encode()), put=mutant["after"])


def run_survivors(folder, survivors, tests):
    """Print for each survivor of an earlier commit the first test that fails, compiled, of those for its module."""
    passed, count = set(), 0
    for mutant in survivors:
        names = tests.get(mutant["path"].removeprefix("satsep_ot/"), [])
        with applied(folder, found_again(folder, mutant)):
            failure = first_failure_compiled(folder, names) if names else ""
        failing = [name for name in names if name.split("::")[0] in failure]
        if failing and failing[0] not in passed:
            without = first_failure_compiled(folder, failing[:1])
            if without:
                raise SystemExit(f"without a mutant: {without}")
            passed.add(failing[0])
        count += bool(failure)
        found = failure.partition(" - ")[0] or "SURVIVES"
        print(f"{mutant['path']}: {mutant['before']} -> {mutant['after']}: {found}", flush=True)
    print(f"noticed: {count} of {len(survivors)} that survived", flush=True)


def report(folder, chosen, results):
    arguments = " ".join(sys.argv[2:])
    lines = [
        f"$ python tests/benchmarks/mutation_check.py FOLDER {re.sub(' ?--(report|hints [^ ]+)', '', arguments)}",
        f"commit {(folder / 'commit').read_text()[:7]}; Python {platform.python_version()}, "
        + ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "numba", "openturns", "pytest")),
        "",
    ]
    total = caught = equal = 0
    for layer in LAYERS:
        of_layer = [mutant for mutant in chosen if layer in mutant["path"] and key(mutant) in results]
        survivors = [mutant for mutant in of_layer if not (results[key(mutant)] or results.get(compiled(mutant)))]
        same = [mutant for mutant in survivors if why_equivalent(mutant)]
        lines.append(
            f"{layer}: {len(of_layer)} mutants, {len(of_layer) - len(survivors)} noticed, {len(same)} equivalent, "
            f"{len(survivors) - len(same)} survive"
        )
        total, caught, equal = total + len(of_layer), caught + len(of_layer) - len(survivors), equal + len(same)
        for mutant in survivors:
            lines += [f"  {mutant['path']}:{mutant['line']}", f"    - {mutant['before']}", f"    + {mutant['after']}"]
            if why_equivalent(mutant):
                lines.append(f"    equivalent: {why_equivalent(mutant)}")
    share = 100.0 * caught / max(1, total - equal)
    lines.append(f"noticed: {caught} of {total - equal} that differ, {share:.1f} %")
    return "\n".join(lines)


def key(mutant):
    return f"{mutant['path']}:{mutant['start']}:{mutant['put']}"


def compiled(mutant):
    return f"compiled {key(mutant)}"


def why_equivalent(mutant):
    return EQUIVALENT.get((mutant["path"].removeprefix("satsep_ot/"), mutant["before"], mutant["after"]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    for layer, number in LAYERS.items():
        parser.add_argument(f"--{layer}", type=int, default=number)
    parser.add_argument("--report", action="store_true", help="print what is known so far")
    parser.add_argument("--hints", type=Path, help="an earlier folder: what noticed a mutant there is run first here")
    parser.add_argument("--survivors", type=Path, help="an earlier folder: make its survivors in the last commit")
    parser.add_argument("--tests", nargs="+", metavar="MODULE=TEST", help="what is run on those of a module")
    options = parser.parse_args()
    folder = options.folder.resolve()
    prepare(folder)
    if options.survivors:
        numbers = {layer: getattr(options, layer) for layer in LAYERS}
        results = json.loads((options.survivors / "results.json").read_text())
        chosen = mutants(options.survivors.resolve(), numbers, options.seed)
        survivors = [mutant for mutant in chosen if not (results[key(mutant)] or why_equivalent(mutant))]
        tests: dict[str, list[str]] = {}
        for module, _, test in (pair.partition("=") for pair in options.tests):
            tests.setdefault(module, []).append(test)
        run_survivors(folder, survivors, tests)
        return
    chosen = mutants(folder, {layer: getattr(options, layer) for layer in LAYERS}, options.seed)
    kept = folder / "results.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    if options.report:
        print(report(folder, chosen, results))
        return
    baseline = Baseline(folder)
    hints = json.loads((options.hints / "results.json").read_text()) if options.hints else {}

    def keep(name, mutant, answer, start):
        results[name] = answer
        kept.write_text(json.dumps(results, indent=0))
        print(
            f"{time.monotonic() - start:4.0f} s {mutant['path']}:{mutant['line']} {mutant['before']} -> "
            f"{mutant['after']}: {answer or 'SURVIVES'}",
            flush=True,
        )

    for mutant in chosen:
        if key(mutant) not in results:
            start = time.monotonic()
            keep(key(mutant), mutant, noticed(baseline, mutant, hints.get(key(mutant))), start)
    left = [mutant for mutant in chosen if not (results[key(mutant)] or why_equivalent(mutant))]
    for mutant in left:
        if compiled(mutant) not in results:
            start = time.monotonic()
            keep(compiled(mutant), mutant, noticed_compiled(baseline, mutant), start)
    print(report(folder, chosen, results))


if __name__ == "__main__":
    # What all mutants share is imported once: each runs in a copy of this process.
    # One thread: one that waits for others cannot be ended.
    threads = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    os.environ |= {"NUMBA_DISABLE_JIT": "1", **threads}
    sys.dont_write_bytecode = True
    for module in ("numba", "openturns", "scipy.linalg", "scipy.stats", "scipy.integrate", "hypothesis", "matplotlib"):
        importlib.import_module(module)
    main()
