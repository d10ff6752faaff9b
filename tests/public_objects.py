"""Objects of every public class, before and after their runs, by name: the one list that common tests go through."""

import openturns as ot

import satsep_ot
from satsep_ot.model.ground_tests import parse_ground_tests

# Exceptions and functions are no objects in this sense.
EXCEPTIONS_AND_FUNCTIONS = {"CaseError", "addToStudy", "readFromStudy", "list_runs", "load_case", "load_runs"}
FORMULA = ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b)"])
LAW = ot.Normal(2)


class Model(ot.OpenTURNSPythonFunction):
    """A user's model that can be pickled."""

    def __init__(self):
        super().__init__(2, 1)

    def _exec(self, x):
        return [x[0] + x[1] ** 2]


def done(algorithm):
    algorithm.run()
    return algorithm


def subspace(function=FORMULA):
    algorithm = satsep_ot.ActiveSubspaceAlgorithm(function, LAW)
    algorithm.setSamplingSize(20)
    algorithm.setBootstrapSize(20)
    return algorithm


def sample():
    inputs = LAW.getSample(40)
    return inputs, FORMULA(inputs)


def regression():
    return satsep_ot.MultivariatePolynomialRegression(*sample(), LAW)


def ridge():
    algorithm = satsep_ot.RidgeApproximation(*sample(), LAW)
    algorithm.setLargestDimension(1)
    return algorithm


def stream():
    found = satsep_ot.MonteCarloStream(FORMULA, LAW, 2000)
    found.setEvents({"large": (0, ot.Greater(), 2.0)})
    return found


def event(function=FORMULA):
    return ot.ThresholdEvent(ot.CompositeRandomVector(ot.Function(function), ot.RandomVector(LAW)), ot.Greater(), 3.0)


def reliability(function=FORMULA):
    return satsep_ot.ActiveSubspaceReliability(event(function))


def conditional():
    law = ot.JointDistribution([ot.Bernoulli(0.2), ot.Normal()])
    vector = ot.CompositeRandomVector(FORMULA, ot.RandomVector(law))
    return satsep_ot.ConditionalReliability(ot.ThresholdEvent(vector, ot.Greater(), 3.0))


def comparison():
    return satsep_ot.ReliabilityComparison(event(), ["FORM"])


def task():
    from satsep_ot.methods.comparison.problems import getBenchmarkProblem

    return satsep_ot.BenchmarkTask.of(getBenchmarkProblem("RP107"))


def benchmark():
    return satsep_ot.ReliabilityBenchmark([task()], ["FORM"], repetitions=2)


def study():
    problem = satsep_ot.SeparationProblem("reference")
    return satsep_ot.SeparationStudy(problem, methods=["MonteCarlo"], sampleSize=2000)


def sampledStudy():
    found = study()
    found.computeSample()
    return found


# Name of the class -> states of an object of it.
def update():
    case = satsep_ot.load_case("reference")
    tests = parse_ground_tests("test,quantity,value,sigma\nscale,satellite.mass,100.4,0.05", case)
    return satsep_ot.SeparationUpdate(case, tests, size=100)


OBJECTS = {
    "ActiveSubspaceAlgorithm": {
        "new": subspace,
        "done": lambda: done(subspace()),
        "of a Python model": lambda: subspace(Model()),
    },
    "ActiveSubspaceReliability": {
        "new": reliability,
        "done": lambda: done(reliability()),
        "of a Python model": lambda: done(reliability(Model())),
    },
    "ActiveSubspaceReliabilityResult": {
        "new": lambda: done(reliability()).getResult(),
        "of a Python model": lambda: done(reliability(Model())).getResult(),
    },
    "ActiveSubspaceResult": {"new": lambda: done(subspace()).getResult()},
    "AskTellReliability": {"new": lambda: satsep_ot.AskTellReliability(reliability(), "state")},
    "ConditionalReliability": {"new": conditional, "done": lambda: done(conditional())},
    "ConditionalReliabilityResult": {"new": lambda: done(conditional()).getResult()},
    "MonteCarloStream": {"new": stream, "done": lambda: done(stream())},
    "MonteCarloStreamResult": {"new": lambda: done(stream()).getResult()},
    "MultivariatePolynomialRegression": {"new": regression, "done": lambda: done(regression())},
    "MultivariatePolynomialRegressionResult": {"new": lambda: done(regression()).getResult()},
    "ParallelFunction": {"new": lambda: satsep_ot.ParallelFunction(Model())},
    "PolynomialDistribution": {"new": lambda: satsep_ot.PolynomialDistribution(done(regression()).getResult())},
    "BenchmarkTask": {"new": task},
    "ReliabilityBenchmark": {"new": benchmark, "done": lambda: done(benchmark())},
    "ReliabilityBenchmarkResult": {"new": lambda: done(benchmark()).getResult()},
    "ReliabilityComparison": {"new": comparison, "done": lambda: done(comparison())},
    "ReliabilityComparisonResult": {"new": lambda: done(comparison()).getResult()},
    "RidgeApproximation": {"new": ridge, "done": lambda: done(ridge())},
    "RidgeApproximationResult": {"new": lambda: done(ridge()).getResult()},
    "SeparationFunction": {"new": lambda: satsep_ot.SeparationFunction("reference")},
    "SeparationProblem": {"new": lambda: satsep_ot.SeparationProblem("reference")},
    "TrueRuns": {"new": lambda: done(reliability()).getResult().getTrueRuns()},
    "SeparationStudy": {"new": study, "done": sampledStudy},
    "SeparationUpdate": {"new": update, "done": lambda: done(update())},
}
CASES = [(name, state) for name, states in OBJECTS.items() for state in states]


def make(name, state):
    """A new object, the same at every call."""
    ot.RandomGenerator.SetSeed(5)
    return OBJECTS[name][state]()
