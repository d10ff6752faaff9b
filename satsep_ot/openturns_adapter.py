"""Every workaround for OpenTURNS 1.27, each with a comment that says what can be removed once it is mended there.

The rest of the package uses OpenTURNS as its documentation describes it. Two workarounds are no functions and stand in
other modules: a command watches its work from a second process (`interruption`), and `SeparationFunction` takes the
wanted quantities as an argument, since `getMarginal` drops the diagonal of a Hessian in Python.
"""

import contextlib
import ctypes
import re
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import openturns as ot
import openturns.experimental as otexp

try:
    import dill
except ImportError:
    dill = None

# What OpenTURNS raises where a distribution refuses its parameters or has no quantiles: its exceptions have no common
# base class in Python. Remove when they have one.
REFUSALS = (RuntimeError, TypeError, ValueError, IndexError, MemoryError)
# OpenTURNS adds to the message of an error in a Python function a traceback for each function in between, and to every
# message the class of its own exception. Remove both patterns when it raises the original exception (announced for
# 1.28).
_TRACEBACK = re.compile(r"\s*Traceback \(most recent call last\):\n(?:[ \t].*\n)+.*\n?\s*")
_EXCEPTION_CLASS = re.compile(
    r"\b(Internal|InvalidArgument|InvalidDimension|InvalidRange|NotDefined|NotSymmetricDefinitePositive|"
    r"NotYetImplemented|OutOfBound)Exception : "
)
_OPENTURNS = str(Path(ot.__file__).parent)
_FINITE_DIFFERENCES = re.compile(r"class=\w*FiniteDifference")


# What signal.getsignal says where no function of Python is called.
_NO_HANDLER = (signal.SIG_DFL, signal.SIG_IGN, None)
# The interpreter's own handler of any signal that Python handles. It is read before OpenTURNS has one in its place.
ctypes.pythonapi.PyOS_getsig.restype = ctypes.c_void_p
ctypes.pythonapi.PyOS_setsig.restype = ctypes.c_void_p
ctypes.pythonapi.PyOS_setsig.argtypes = [ctypes.c_int, ctypes.c_void_p]
_PYTHON_HANDLER = (
    None if signal.getsignal(signal.SIGINT) in _NO_HANDLER else ctypes.pythonapi.PyOS_getsig(signal.SIGINT)
)


# Errors. --------------------------------------------------------------------------------------------------------------


def raiseInterrupt(error: BaseException) -> None:
    """Raise KeyboardInterrupt where this error stands for one; to be called first where an error is caught.

    Raises
    ------
    KeyboardInterrupt
        An interrupt inside a Python function is the cause.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import raiseInterrupt
    >>> def interrupted(x):
    ...     raise KeyboardInterrupt
    >>> try:
    ...     ot.PythonFunction(1, 1, interrupted)([0.0])
    ... except RuntimeError as error:
    ...     try:
    ...         raiseInterrupt(error)
    ...     except KeyboardInterrupt:
    ...         print("interrupted")
    interrupted
    """
    # OpenTURNS raises a RuntimeError in its place, of the latter text where its own code was interrupted. Remove when
    # it raises the original exception (announced for 1.28).
    if "KeyboardInterrupt" in str(error) or str(error).startswith("Interruption in OT::"):
        raise KeyboardInterrupt from error


@contextlib.contextmanager
def raisingInterrupts() -> Iterator[None]:
    """A block in which an error of OpenTURNS that stands for an interrupt becomes KeyboardInterrupt."""
    try:
        yield
    except RuntimeError as error:
        raiseInterrupt(error)
        raise


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """A block of calls of OpenTURNS that may call Python functions: Ctrl-C raises KeyboardInterrupt, in any thread.

    Examples
    --------
    >>> import signal
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import interruptible
    >>> function = ot.PythonFunction(1, 1, lambda x: signal.raise_signal(signal.SIGINT) or x)
    >>> try:
    ...     with interruptible():
    ...         function([0.0])
    ... except KeyboardInterrupt:
    ...     print("interrupted")
    interrupted
    """
    # While any of its functions runs, OpenTURNS answers SIGINT itself, by an exception of C++ that it throws out of the
    # handler, also over the frames of Python that it has called in between: the interpreter ends, at once or later. So
    # the first Python function that it calls puts Python's own handler back, which only notes the signal; OpenTURNS
    # does so too at its end. What remains are the milliseconds in which nothing but OpenTURNS runs. Remove when it
    # leaves the signal alone.
    if _PYTHON_HANDLER is None or signal.getsignal(signal.SIGINT) in _NO_HANDLER or sys.getprofile() is not None:
        yield
        return

    def atCall(frame, event, argument):
        if event == "call":
            ctypes.pythonapi.PyOS_setsig(signal.SIGINT, _PYTHON_HANDLER)
            # Functions of OpenTURNS come first, some before its handler is in place, one after: while it prepares the
            # points for the user's function, Python's handler is there already.
            if not frame.f_code.co_filename.startswith(_OPENTURNS):
                sys.setprofile(None)

    with raisingInterrupts():
        sys.setprofile(atCall)
        try:
            yield
        finally:
            sys.setprofile(None)


def errorMessage(error: BaseException) -> str:
    """The message of an error on one line, without the tracebacks and exception classes that OpenTURNS adds.

    Examples
    --------
    >>> from satsep_ot.openturns_adapter import errorMessage
    >>> errorMessage(RuntimeError("mass = -1\\nTraceback (most recent call last):\\n  File 'a'\\nValueError: x\\n"))
    'mass = -1'
    """
    plain = " ".join(_TRACEBACK.sub("\n", str(error)).split())
    return _EXCEPTION_CLASS.sub("", plain)


# What kind of object it is. -------------------------------------------------------------------------------------------


def hasGradient(function: ot.Function) -> bool:
    """Whether a function, and every part of a composed one, has a gradient that is not by finite differences.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import hasGradient
    >>> hasGradient(ot.SymbolicFunction("x", "x^2")), hasGradient(ot.PythonFunction(1, 1, lambda x: x))
    (True, False)
    """
    # Only the full text shows the parts of a composed gradient. Remove when a function tells (isActualGradient or so).
    return not _FINITE_DIFFERENCES.search(repr(function.getGradient()))


def hasHessian(function: ot.Function) -> bool:
    """Whether a function, and every part of a composed one, has a Hessian that is not by finite differences.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import hasHessian
    >>> hasHessian(ot.SymbolicFunction("x", "x^2")), hasHessian(ot.PythonFunction(1, 1, lambda x: x))
    (True, False)
    """
    # As for `hasGradient`.
    return not _FINITE_DIFFERENCES.search(repr(function.getHessian()))


def isOpenTURNS(thing: Any) -> bool:
    """Whether an object is one of OpenTURNS' own.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import isOpenTURNS
    >>> isOpenTURNS(ot.Point(2)), isOpenTURNS([0.0, 0.0])
    (True, False)
    """
    # They have one base class in C++, but none in Python. Remove when they have.
    return type(thing).__module__.startswith("openturns.") and hasattr(thing, "thisown")


def sameObjects(first: Any, second: Any) -> bool:
    """Whether two OpenTURNS objects print the same, with all digits; Python functions print their names only.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import sameObjects
    >>> sameObjects(ot.HermiteFactory(), ot.HermiteFactory()), sameObjects(ot.Dirac(0.1), ot.Dirac(0.1000000001))
    (True, False)
    """
    # Two events, or two polynomial factories, are never equal, two functions always. Remove when == compares states.
    return type(first) is type(second) and exactText(first) == exactText(second)


def exactText(thing: Any) -> str:
    """All that an OpenTURNS object prints of itself, with all digits; Python functions print their names only.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import exactText
    >>> exactText(ot.Dirac(0.1)).split("values=")[1]
    '[0.10000000000000001]'
    """
    # The number of digits is a setting of the whole process. Remove when repr() has all of them.
    precision = ot.PlatformInfo.GetNumericalPrecision()
    ot.PlatformInfo.SetNumericalPrecision(17)
    try:
        return repr(thing)
    finally:
        ot.PlatformInfo.SetNumericalPrecision(precision)


def generatorState() -> dict[str, Any]:
    """The state of ``ot.RandomGenerator`` as plain data, for `setGeneratorState`.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import generatorState, setGeneratorState
    >>> state = generatorState()
    >>> number = ot.RandomGenerator.Generate()
    >>> setGeneratorState(state)
    >>> ot.RandomGenerator.Generate() == number
    True
    """
    state = ot.RandomGenerator.GetState()
    ot.RandomGenerator.Generate()
    if state.getIndex() == 0 and ot.RandomGenerator.GetState().getBuffer() != state.getBuffer():
        # Before its first use it has no state, only a seed. Remove when GetState() gives what it would begin with.
        ot.RandomGenerator.SetSeed(ot.ResourceMap.GetAsUnsignedInteger("RandomGenerator-InitialSeed"))
        state = ot.RandomGenerator.GetState()
    ot.RandomGenerator.SetState(state)
    return {"buffer": list(state.getBuffer()), "index": state.getIndex()}


def setGeneratorState(state: dict[str, Any]) -> None:
    """Let ``ot.RandomGenerator`` go on from a state."""
    ot.RandomGenerator.SetState(ot.RandomGeneratorState(ot.Indices(state["buffer"]), state["index"]))


def isPython(thing: Any) -> bool:
    """Whether an OpenTURNS object is made of Python code, which a study stores as a pickle.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import isPython
    >>> isPython(ot.SymbolicFunction("x", "x^2")), isPython(ot.Function(ot.PythonFunction(1, 1, lambda x: x)))
    (False, True)
    """
    # Not by its XML: the pickle of a function takes all that it refers to along. Remove when an object tells.
    return "class=Python" in repr(thing)


def eventKind(event: Any) -> str:
    """Class name of an event, also of one that is wrapped as a RandomVector.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import eventKind
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("a", "a"), ot.RandomVector(ot.Normal()))
    >>> eventKind(ot.RandomVector(ot.ThresholdEvent(vector, ot.Greater(), 2.0)))
    'ThresholdEvent'
    """
    # Python's own objects, and some of OpenTURNS', have no such method.
    if not hasattr(event, "getClassName"):
        return type(event).__name__
    name = event.getClassName()
    if name != "RandomVector":
        return name
    # getImplementation() of a wrapped ThresholdEvent is a bare pointer. Remove when it is an object of its class.
    return repr(event).split("implementation=class=")[1].split()[0].removesuffix("Implementation")


def parameterNames(distribution: ot.Distribution, index: int = 0) -> list[str]:
    """Names of the parameters of a univariate distribution, for instance ["mu", "sigma"].

    Parameters
    ----------
    distribution : :py:class:`openturns.Distribution`
    index : int
        Its position in the joint distribution that it was taken from.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import parameterNames
    >>> parameterNames(ot.JointDistribution([ot.Normal()] * 3).getMarginal(2), 2)
    ['mu', 'sigma']
    """
    # Some distributions append the position in the joint distribution, others 0. Remove when all names are plain.
    return [name.removesuffix(f"_{index}").removesuffix("_0") for name in distribution.getParameterDescription()]


@contextlib.contextmanager
def withoutWarnings() -> Iterator[None]:
    """OpenTURNS prints no warning inside; a `NormalGamma` warns of its own default parameters.

    Remove when it does not, or when OpenTURNS warns as Python does.
    """
    flags = ot.Log.Flags()
    ot.Log.Show(flags & ~ot.Log.WARN)
    try:
        yield
    finally:
        ot.Log.Show(flags)


def endsInterpreter(copula: ot.Distribution) -> bool:
    """Whether a joint distribution with this copula ends the interpreter.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import endsInterpreter
    >>> endsInterpreter(ot.NormalCopula(2))
    False
    """
    # Its iso-probabilistic transformation recurses without end. Remove when it raises an exception or works.
    return ot.Distribution(copula).getImplementation().getClassName() == "StudentCopula"


# Evaluating and counting. ---------------------------------------------------------------------------------------------


def callFunction(function: ot.Function, points: np.ndarray) -> np.ndarray:
    """An OpenTURNS function at points (n, d), as a new array (n, p)."""
    points = np.ascontiguousarray(points, dtype=float)
    sample = ot.Sample(*points.shape)
    # OpenTURNS reads an array number by number, 25 times slower. A new sample shares its memory with no other one.
    # Remove when ot.Sample(array) copies the memory at once.
    ctypes.memmove(sample.__array_interface__["data"][0], points.ctypes.data, points.nbytes)
    with interruptible():
        values = function(sample)
    return np.array(values, dtype=float)


class Counter:
    """Numbers of evaluations and gradients.

    Parameters
    ----------
    record : callable, optional
        Called with the inputs (n, d) and outputs (n, p) of every evaluation.
    limit : int, optional
        Of evaluations and gradients together.
    """

    def __init__(
        self, record: Callable[[np.ndarray, np.ndarray], None] | None = None, limit: int | None = None
    ) -> None:
        self.evaluations = 0
        self.gradients = 0
        self.record = record
        self.limit = limit

    def require(self, number: int) -> None:
        """Refuse so many more, before they are made.

        Raises
        ------
        RuntimeError
            They would exceed the limit.
        """
        if self.limit is not None and self.evaluations + self.gradients + number > self.limit:
            raise RuntimeError(
                f"the limit of {self.limit} evaluations does not allow {number} more after "
                f"{self.evaluations + self.gradients}"
            )


def countingFunction(function: ot.Function, counter: Counter, distribution: ot.Distribution) -> ot.Function:
    """The same function, counting its evaluations and gradients in ``counter``.

    A function without a gradient of its own gets centred differences whose steps are 1e-3 standard deviations of each
    input, which are evaluations. The Hessian is by differences: of gradients if there are any, otherwise of values.
    An evaluation that is not finite raises.
    """
    d, p = function.getInputDimension(), function.getOutputDimension()
    steps = 1e-3 * np.array(distribution.getStandardDeviation())

    # OpenTURNS copies functions and counts in the copies, no gradients in Python at all, and a batch of Hessians only
    # in the parent: closures are shared by all copies. Remove when getEvaluationCallsNumber and
    # getGradientCallsNumber of an algorithm's function are complete.
    def evaluate(sample):
        points = np.asarray(sample, dtype=float)
        counter.require(len(points))
        values = callFunction(function, points)
        counter.evaluations += len(values)
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            # OpenTURNS takes NaN for a point outside the event. Remove when it raises.
            row = int(np.argmin(finite))
            raise ValueError(
                f"{np.count_nonzero(~finite)} of {len(values)} values are not finite, the first one is "
                f"{values[row].tolist()} at input {points[row].tolist()}"
            )
        if counter.record is not None:
            # OpenTURNS may use the memory again.
            counter.record(points.copy(), values.copy())
        return values

    def gradient(point):
        counter.require(1)
        counter.gradients += 1
        return np.array(function.gradient(point))

    def hessian(point):
        result = np.empty((d, d, p))
        for i, step in enumerate(steps):
            shift = np.zeros(d)
            shift[i] = step
            result[i] = (gradient(np.asarray(point) + shift) - gradient(np.asarray(point) - shift)) / (2.0 * step)
        return 0.5 * (result + result.transpose(1, 0, 2))

    if hasGradient(function):
        return ot.PythonFunction(d, p, func_sample=evaluate, gradient=gradient, hessian=hessian)
    # OpenTURNS' own step is 1e-5 for all inputs, whatever their units. Remove when it follows their scatter.
    counting = ot.PythonFunction(d, p, func_sample=evaluate)
    counting.setGradient(ot.CenteredFiniteDifferenceGradient(steps.tolist(), counting.getEvaluation()))
    # The rounding error of a second difference is divided by the square of the step.
    counting.setHessian(ot.CenteredFiniteDifferenceHessian((30.0 * steps).tolist(), counting.getEvaluation()))
    return counting


def minimumFunction(size: int) -> ot.Function:
    """The smallest of several numbers as a native function with exact derivatives.

    Examples
    --------
    >>> from satsep_ot.openturns_adapter import minimumFunction
    >>> function = minimumFunction(3)
    >>> print(function([3.0, 1.0, 2.0]), function.gradient([3.0, 1.0, 2.0]).transpose())
    [1] [[ 0 1 0 ]]
    """
    variables = [f"v{k}" for k in range(size)]
    function = ot.SymbolicFunction(variables, [f"min({', '.join(variables)})"])
    # OpenTURNS does not differentiate min, but does differentiate (a + b - |a - b|) / 2, which in turn rounds: values
    # come from the former, derivatives from the latter, by pairs so that the formulas stay short. Remove the pairs
    # when min has derivatives.
    pairs = ot.IdentityFunction(size)
    while size > 1:
        names = [f"v{k}" for k in range(size)]
        halved = [f"({a} + {b} - abs({a} - {b})) / 2" for a, b in zip(names[::2], names[1::2], strict=False)]
        pairs = ot.ComposedFunction(ot.SymbolicFunction(names, halved + names[len(halved) * 2 :]), pairs)
        size = (size + 1) // 2
    function.setGradient(pairs.getGradient())
    function.setHessian(pairs.getHessian())
    return function


def multiFORMProbability(result: ot.MultiFORMResult) -> float:
    """The probability of a MultiFORM result, also of one with a single design point."""
    points = result.getFORMResultCollection()
    # getEventProbability() of a single one is -1. Remove when it is FORM's.
    return points[0].getEventProbability() if len(points) == 1 else result.getEventProbability()


def latinHypercube() -> ot.LHSExperiment:
    """A Latin hypercube design for an algorithm that draws several blocks of it."""
    experiment = ot.LHSExperiment()
    # By default all blocks have one permutation, which biases their mean. Remove when each block is shuffled.
    experiment.setAlwaysShuffle(True)
    return experiment


def lineSampling(event: ot.ThresholdEvent, direction: Any) -> otexp.LineSampling:
    """Line sampling along a fixed direction of the standard space, which finds limit states up to a distance of 9."""
    # With the step of 1 by default a limit state at a whole distance is lost on half of the lines. Remove the step when
    # a root at the end of a step is found.
    algorithm = otexp.LineSampling(event, direction, ot.SafeAndSlow(ot.Brent(), 9.0, 0.9871))
    # The adaptive direction, the default, jumps to any nearer failure, and the estimate with it. Remove when all lines
    # of an estimate have one direction.
    algorithm.setAdaptiveImportantDirection(False)
    return algorithm


def lastLevel(algorithm: ot.SubsetSampling) -> float:
    """The level at which subset sampling ended; its estimate is of the event only if this is the threshold."""
    # The result has no word of levels that stop short of the event. Remove when its probability is then refused.
    return algorithm.getThresholdPerStep()[-1]


# Storing and sending. -------------------------------------------------------------------------------------------------


def toXML(thing: Any) -> str:
    """An OpenTURNS object as XML text."""
    with _study() as (path, study):
        study.add("object", thing)
        study.save()
        return path.read_text(encoding="utf-8")


def fromXML(text: str, thing: Any) -> Any:
    """Fill an empty OpenTURNS object of the right class from `toXML`'s text, and return it.

    Raises
    ------
    ValueError
        The text is no XML, or holds a Python object: OpenTURNS stores these as pickles, which can execute anything
        when they are loaded.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import fromXML, toXML
    >>> fromXML(toXML(ot.Normal(0.1, 1.0 / 3.0)), ot.Normal()).getParameter()[1] == 1.0 / 3.0
    True
    """
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"the text is no XML: {error}") from error
    # OpenTURNS executes what it finds. Remove the check when a study can be loaded without its Python objects.
    for element in tree.iter():
        if "python" in element.get("class", "").lower():
            raise ValueError(
                f"the text holds a {element.get('class')}, a pickle that can execute anything; only OpenTURNS' own "
                "objects are loaded"
            )
    with _study() as (path, study):
        # Written anew, so that OpenTURNS reads what was checked, without entities and document types.
        path.write_bytes(ElementTree.tostring(tree, encoding="utf-8", xml_declaration=True))
        study.load()
        study.fillObject("object", thing)
    return thing


def domainMembers(domain: ot.Domain) -> list[Any]:
    """The domains that a union, intersection, difference or complement is made of, in their order.

    Raises
    ------
    TypeError
        One of them cannot be stored, such as a level set of a Python function that holds a lock.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.openturns_adapter import domainMembers
    >>> union = ot.DomainUnion([ot.Interval(0.0, 1.0), ot.DomainComplement(ot.Interval(3.0, 9.0))])
    >>> [member.getClassName() for member in domainMembers(union)]
    ['Interval', 'DomainComplement']
    """
    # They have no accessor. Remove when they have.
    try:
        tree = ElementTree.fromstring(toXML(domain))
    except RuntimeError as error:
        raise TypeError(f"the members of the {domain.getClassName()} cannot be read: {errorMessage(error)}") from error
    objects = {element.get("id"): element for element in tree.iter("object") if element.get("class")}
    whole = next(element for element in objects.values() if element.get("StudyLabel") == "object")
    members = [objects[child.get("id")] for child in whole]
    if "Collection" in members[0].get("class", ""):
        members = [objects[child.get("id")] for child in members[0]]
    for number, member in enumerate(members):
        member.set("StudyLabel", f"member {number}")
        member.set("StudyVisible", "true")
    with _study() as (path, study):
        path.write_bytes(ElementTree.tostring(tree, encoding="utf-8", xml_declaration=True))
        study.load()
        found = [getattr(ot, member.get("class", ""))() for member in members]
        for number, thing in enumerate(found):
            study.fillObject(f"member {number}", thing)
    return found


@contextlib.contextmanager
def _study() -> Iterator[tuple[Path, ot.Study]]:
    # A study reads and writes files only. Remove when it takes text or a stream.
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "object.xml"
        study = ot.Study()
        study.setStorageManager(ot.XMLStorageManager(str(path)))
        yield path, study


@contextlib.contextmanager
def picklingGlobals() -> Iterator[None]:
    """A block in which the pickle of a function of a script takes along the modules and numbers that it uses."""
    # OpenTURNS pickles Python functions with dill where it is installed, and with dill's defaults, which leave these
    # out. Remove when it uses cloudpickle or dill's "recurse".
    if dill is None:
        yield
        return
    before = dill.settings["recurse"]
    dill.settings["recurse"] = True
    try:
        yield
    finally:
        dill.settings["recurse"] = before


class Shared:
    """A value that all copies of a Python function share; it is not part of a pickle."""

    # OpenTURNS works on deep copies of a Python function. Remove when it keeps references.
    def __init__(self) -> None:
        self.value: Any = None

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        return Shared, ()
