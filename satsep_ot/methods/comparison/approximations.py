"""Methods that replace the limit state by a plane or a paraboloid at its design points."""

from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.comparison.method import CountedProblem, ReliabilityMethod, Row
from satsep_ot.openturns_adapter import errorMessage, multiFORMProbability, raiseInterrupt


class FORM(ReliabilityMethod):
    """First-order method by Abdo-Rackwitz, by SQP where that does not reach the limit state, at last by Cobyla.

    The search starts at 0.1 in every coordinate of the standard space: at the origin itself the gradient of a norm or
    of an absolute value does not exist. There is no interval: nothing tells how far the limit state is from its tangent
    plane.

    Parameters
    ----------
    maximumIterations : int
        Of each solver.
    start : float
        Coordinate of the starting point in standard space.
    """

    name = "FORM"

    def __init__(self, maximumIterations: int = 100, start: float = 0.1) -> None:
        self.maximumIterations = maximumIterations
        self.start = start

    def solve(self, problem: CountedProblem, algorithmClass: Any) -> tuple[Any, bool, str]:
        """Result of FORM or SORM, whether the design point was reached, and a note."""
        space = StandardSpace(problem.distribution)
        start = space.toPhysical(np.full((1, space.getDimension()), self.start))[0]
        notes = []
        for solver in (ot.AbdoRackwitz(), ot.SQP(), ot.Cobyla()):
            solver.setStartingPoint(start)
            solver.setMaximumIterationNumber(self.maximumIterations)
            solver.setMaximumCallsNumber(30 * self.maximumIterations)
            algorithm = algorithmClass(solver, problem.event)
            try:
                algorithm.run()
            except RuntimeError as error:
                raiseInterrupt(error)
                notes.append(f"{solver.getClassName()}: {errorMessage(error)}")
                continue
            result = algorithm.getResult()
            optimum = result.getOptimizationResult()
            notes.append(
                f"{solver.getClassName()}: reliability index {result.getHasoferReliabilityIndex():.4f} after "
                f"{optimum.getCallsNumber()} calls"
            )
            return result, optimum.getStatus() == ot.OptimizationResult.SUCCESS, "; ".join(notes)
        raise RuntimeError("no solver reached the limit state: " + "; ".join(notes))

    def run(self, problem: CountedProblem) -> Row:
        result, converged, note = self.solve(problem, ot.FORM)
        return Row(self.name, result.getEventProbability(), converged=converged, note=note)


class MultiFORM(FORM):
    """First-order system reliability over several design points, found one after the other (Der Kiureghian and
    Dakessian, Structural Safety 20, 1998), each by Abdo-Rackwitz.

    Parameters
    ----------
    maximumDesignPoints : int
    """

    name = "MultiFORM"

    def __init__(self, maximumDesignPoints: int = 4, maximumIterations: int = 100, start: float = 0.1) -> None:
        super().__init__(maximumIterations, start)
        self.maximumDesignPoints = maximumDesignPoints

    def run(self, problem: CountedProblem) -> Row:
        space = StandardSpace(problem.distribution)
        solver = ot.AbdoRackwitz()
        solver.setStartingPoint(space.toPhysical(np.full((1, space.getDimension()), self.start))[0])
        solver.setMaximumIterationNumber(self.maximumIterations)
        solver.setMaximumCallsNumber(30 * self.maximumIterations)
        algorithm = ot.MultiFORM(solver, problem.event)
        algorithm.setMaximumDesignPointsNumber(self.maximumDesignPoints)
        algorithm.run()
        result = algorithm.getResult()
        note = f"{len(result.getFORMResultCollection())} design points"
        return Row(self.name, multiFORMProbability(result), converged=True, note=note)


class SORM(FORM):
    """Second-order method at FORM's design point, by Breitung's formula.

    The Hessian is by differences: 2 d gradients, or about 2 d^2 evaluations of a function without gradient.
    """

    name = "SORM"
    formula = "Breitung"

    def run(self, problem: CountedProblem) -> Row:
        result, converged, note = self.solve(problem, ot.SORM)
        for formula in ("Breitung", "Hohenbichler", "Tvedt"):
            try:
                value = getattr(result, f"getEventProbability{formula}")()
            except RuntimeError as error:
                if formula == self.formula:
                    raise
                raiseInterrupt(error)
                note += f"; {formula} not defined here"
                continue
            if formula == self.formula:
                probability = value
            else:
                note += f"; {formula} {value:.3e}"
        return Row(self.name, probability, converged=converged, note=note)


class SORMHohenbichler(SORM):
    """`SORM` by the formula of Hohenbichler and Rackwitz."""

    name = "SORMHohenbichler"
    formula = "Hohenbichler"


class SORMTvedt(SORM):
    """`SORM` by the formula of Tvedt."""

    name = "SORMTvedt"
    formula = "Tvedt"
