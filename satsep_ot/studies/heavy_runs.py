"""The probability of a violation by a heavy simulator that runs elsewhere, with this package's simulator beside it."""

import contextlib
import dataclasses
import json
import math
import os
import runpy
from collections.abc import Iterator
from pathlib import Path

import openturns as ot

from satsep_ot.methods.common.storage import writeWhole
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.ask_tell import AskTellReliability, outsideFunction
from satsep_ot.methods.reliability.run_files import RunFiles
from satsep_ot.model.case import SYSTEM, Case, load_uncertain_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.results_directory import DirectoryError, digest, file_stem
from satsep_ot.studies.steps import Made
from satsep_ot.studies.telling.results import Estimate
from satsep_ot.studies.telling.words import StudyMethod

_FORMAT = 1
_QUESTION, _CASE, _STATE, _ORIGIN = "question.json", "case.toml", "state", "separation.json"
# Where no precision is asked for; runs at a precision of 5 % and above.
_PRECISION, _MOST_RUNS = 0.1, 5000
# Coefficient of variation from which on a verdict may end the runs; the wide runs are made first, so that the interval
# has two sides.
_VERDICT_PRECISION = 0.3


@dataclasses.dataclass(frozen=True)
class HeavyQuestion:
    """What heavy runs are asked for.

    Attributes
    ----------
    requirement : str
        Of the case, or "any requirement"; of a Python model its file.
    seed : int
    target : float
        Coefficient of variation at which the runs end.
    maximum : int
        Number of heavy runs at which they end in any case.
    block : int or None
        Smallest number of heavy runs at once; None for as few as the algorithm likes.
    policy : str
        What a run with an output that is not finite is: "raise" (refused), "failure" or "safe".
    alone : bool
        Whether this package's simulator is left out, which else is the cheap model.
    """

    requirement: str
    seed: int = 0
    target: float = 0.1
    maximum: int = 5000
    block: int | None = None
    policy: str = "raise"
    alone: bool = False

    def algorithm(
        self, problem: SeparationProblem, ofAll: bool = False, allowed: float | None = None
    ) -> ActiveSubspaceReliability:
        """The algorithm for a requirement of a case, whose heavy runs are made elsewhere.

        Parameters
        ----------
        problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
        ofAll : bool
            Whether each run gives the quantities of all requirements.
        allowed : float, optional
            The runs also end as soon as the probability is known to be above or below this one.
        """
        name = None if self.requirement == SYSTEM else self.requirement
        event = problem.getSystemEvent() if name is None else problem.getEvent(name)
        simulator, composition = problem.getMeasuredComponents(name, ofAll)
        heavy = outsideFunction(simulator.getInputDescription(), simulator.getOutputDescription())
        variable = ot.CompositeRandomVector(
            ot.ComposedFunction(composition, heavy), ot.RandomVector(problem.getDistribution())
        )
        algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(variable, event.getOperator(), event.getThreshold()))
        algorithm.setComponents(heavy, composition)
        algorithm.setTargetCoefficientOfVariation(self.target)
        algorithm.setMaximumEvaluations(self.maximum)
        algorithm.setBlockSize(self.block)
        algorithm.setNonFinitePolicy(self.policy)
        algorithm.setAllowedProbability(allowed, _VERDICT_PRECISION)
        algorithm.setLowFidelity(None if self.alone else simulator)
        return algorithm

    def begin(self, algorithm: ActiveSubspaceReliability, state: str | os.PathLike) -> AskTellReliability:
        """Ask and tell with a state file; a new one begins with the seed."""
        ot.RandomGenerator.SetSeed(self.seed)
        return AskTellReliability(algorithm, state)


@dataclasses.dataclass(frozen=True)
class HeavyRuns:
    """The heavy runs of a study, in a directory of their own.

    Attributes
    ----------
    directory : :class:`pathlib.Path`
        Of ``block-N-inputs.csv`` and ``block-N-outputs.csv``. Studies that differ in their requirements and settings
        share the runs; another separation, or other distributions of its inputs, are refused.
    block : int or None
    policy : str
        As in `HeavyQuestion`.
    """

    directory: Path
    block: int | None = None
    policy: str = "raise"

    def check(self, case: Case, distribution: ot.Distribution) -> None:
        """Bind the directory to a separation and to its inputs.

        Raises
        ------
        DirectoryError
            It holds the runs of others, or other files.
        """
        path = self.directory / _ORIGIN
        text = json.dumps({"format": _FORMAT, "separation": digest(case.separation, distribution)}) + "\n"
        if path.exists():
            if path.read_text(encoding="utf-8") != text:
                raise DirectoryError(
                    f"{self.directory} holds the heavy runs of another separation, or of other inputs; give another "
                    "directory"
                )
            return
        if self.directory.exists() and any(self.directory.iterdir()):
            raise DirectoryError(f"{self.directory} holds other files, and no heavy runs of a study; give another one")
        self.directory.mkdir(parents=True, exist_ok=True)
        _write(path, text.encode())

    def estimate(
        self, problem: SeparationProblem, requirement: str, seed: int, precision: float | None, level: float
    ) -> Made:
        """The probability of violating a requirement by heavy runs.

        Parameters
        ----------
        problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
        requirement : str
            Its name, or "any requirement".
        seed : int
        precision : float or None
            Coefficient of variation at which the runs end. None: at 0.1, or from 0.3 on as soon as the
            requirement is decided.
        level : float
            At which the intervals of all requirements hold at once.

        Raises
        ------
        RunsNeeded
            Some are not there yet.
        DirectoryError
            A file is not as it was written, or outputs do not fit to the inputs.
        """
        allowed = {entry.name: entry.allowed_probability for entry in problem.getRequirements()}.get(requirement)
        allowed = allowed if precision is None else None
        target = _PRECISION if precision is None else precision
        most = math.ceil(_MOST_RUNS * max(1.0, (0.05 / target) ** 2))
        question = HeavyQuestion(requirement, seed, target, most, self.block, self.policy)
        algorithm = question.algorithm(problem, ofAll=True, allowed=allowed)
        # Another computation has another state, and the same runs.
        own = digest(dataclasses.astuple(question), allowed, [str(entry) for entry in problem.getRequirements()])
        state = self.directory / f"{file_stem(['state', requirement])}-{own[:8]}"
        with telling_errors():
            result = RunFiles(self.directory).advance(question.begin(algorithm, state))
        interval = result.getConfidenceInterval(0.95)
        variation = result.getCoefficientOfVariation()
        estimate = Estimate(
            requirement,
            StudyMethod.ACTIVE_SUBSPACE,
            result.getProbabilityEstimate(),
            interval.getLowerBound()[0],
            interval.getUpperBound()[0],
            coefficient_of_variation=variation if math.isfinite(variation) else None,
            evaluations=result.getEvaluationNumber(),
            converged=result.getConverged(),
            note=f"heavy runs; {result.getEndingSentence()}",
            audits=result.getAuditNumber(),
            audit_spread=result.getAuditSpread(),
            upper_together=result.getConfidenceInterval(level).getUpperBound()[0],
        )
        names = problem.getMeasuredComponents(None)[0].getOutputDescription()
        return Made(estimate, result.getTrueRuns(names), result)

    def assumption(self) -> str:
        """What a report says of them."""
        return (
            "The probabilities are those of the heavy runs. The distributions of the quantities, the active subspaces, "
            "the most likely violations and the motion are of this package's own simulator; failures of parts, fleets, "
            "curves and classes of tolerances are left out."
        )


@contextlib.contextmanager
def telling_errors() -> Iterator[None]:
    """A block whose errors of runs and states are errors of their directory, in one sentence."""
    try:
        yield
    except ValueError as error:
        raise DirectoryError(str(error)) from error


def begin_question(directory: Path, question: HeavyQuestion, case: Case | None) -> None:
    """Keep a question in a directory of its own, with its case.

    Parameters
    ----------
    directory : :class:`pathlib.Path`
        Made where it does not exist.
    question : HeavyQuestion
    case : :class:`satsep_ot.model.case.Case`, optional
        None for a Python model, whose file is named by the question.

    Raises
    ------
    DirectoryError
        The directory holds another question, or other files.
    """
    text = json.dumps({"format": _FORMAT, "python": case is None, **dataclasses.asdict(question)}, indent=2) + "\n"
    files = {} if case is None else {_CASE: case.text, **case.files}
    path = directory / _QUESTION
    if path.exists():
        _refuse_other(directory, files | {_QUESTION: text})
        return
    if directory.exists() and any(directory.iterdir()):
        raise DirectoryError(f"{directory} holds other files; give a directory of its own")
    directory.mkdir(parents=True, exist_ok=True)
    # The question last: where it is, all is there.
    for name, content in [*files.items(), (_QUESTION, text)]:
        _write(directory / name, content.encode())


def _write(path, content):
    writeWhole(path, lambda stream: stream.write(content))


def _refuse_other(directory, files):
    for name, content in files.items():
        path = directory / name
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            raise DirectoryError(
                f"{directory} holds another question ({name} differs); leave out what begins one to go on with it, or "
                "give another directory"
            )


def load_question(directory: Path) -> tuple[HeavyQuestion, AskTellReliability]:
    """The question of a directory, to go on with. The file of a Python model is executed.

    Raises
    ------
    DirectoryError
        There is none, or it cannot be read.
    """
    path = directory / _QUESTION
    if not path.exists():
        raise DirectoryError(f"{directory} holds no question; begin one with --case and --requirement, or with --model")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        is_known = content.pop("format") == _FORMAT
        is_python = content.pop("python")
        question = HeavyQuestion(**content)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DirectoryError(f"{path} cannot be read ({error}); give another directory") from error
    if not is_known:
        raise DirectoryError(f"{path} is of another version; give another directory")
    if is_python:
        algorithm = python_algorithm(Path(question.requirement))
        if question.block is not None:
            algorithm.setBlockSize(question.block)
    else:
        algorithm = question.algorithm(SeparationProblem(load_uncertain_case(directory / _CASE)))
    return question, question.begin(algorithm, directory / _STATE)


def python_algorithm(path: Path) -> ActiveSubspaceReliability:
    """The `algorithm` that a Python file defines. The file is executed.

    Raises
    ------
    DirectoryError
        There is no such file, or it defines none.
    """
    if not path.is_file():
        raise DirectoryError(f"{path}: there is no such file; give a Python file that defines algorithm")
    found = runpy.run_path(str(path)).get("algorithm")
    if not isinstance(found, ActiveSubspaceReliability):
        raise DirectoryError(f"{path} must define algorithm, an ActiveSubspaceReliability; it is {found!r}")
    return found
