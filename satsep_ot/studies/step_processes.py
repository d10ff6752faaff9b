"""Processes that make the steps of a study side by side; new ones where one of them has died."""

import pickle
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.scheduler import endExecutor
from satsep_ot.methods.parallel.worker import load
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.studies.steps import Made, Step, StudySteps

# How often processes may die, for want of memory or killed, before a study gives up.
_ATTEMPTS = 3
_WATCH = 2.0  # s between two looks at processes that may have died


class StepError(RuntimeError):
    """Steps of a study that could not be made: the processes that made them died again and again."""


class StepProcesses:
    """Makes steps in several processes, or one after the other in this one.

    Parameters
    ----------
    number : int
        How many processes; 1 for this one alone.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._pool: Any = None

    def __getstate__(self) -> dict[str, Any]:
        # Processes stay where they are.
        return {"_number": self._number, "_pool": None}

    def begin(self, study: StudySteps) -> None:
        """Let the processes load what they need, while something else is done."""
        if self._number > 1:
            payload = _payload(study)
            for _ in range(self._number):
                self._submit(_begin, payload)

    def make(
        self, study: StudySteps, steps: Sequence[Step], report: Callable[[str, int], None]
    ) -> Iterator[tuple[Step, Made]]:
        """Make steps.

        Parameters
        ----------
        study : StudySteps
        steps : sequence of Step
            They are begun in this order.
        report : callable
            Called with the label of what is being made and the number of steps that are done.

        Returns
        -------
        made : iterator of (Step, Made)
            As they are finished. A step's numbers do not depend on where it was made.

        Raises
        ------
        StepError
            If processes died three times, with the steps that are missing.
        """
        waiting = list(steps)
        if self._number == 1:
            for number, step in enumerate(waiting):
                report(step.label, number)
                yield step, step.make(study)
            return
        payload = _payload(study)
        for _ in range(_ATTEMPTS):
            futures = {}
            try:
                for step in waiting:
                    futures[self._submit(_make, payload, step)] = step
                while waiting:
                    report(waiting[0].label, len(steps) - len(waiting))
                    future = self._finished(futures)
                    made = future.result()
                    step = futures.pop(future)
                    waiting.remove(step)
                    yield step, made
                return
            except BrokenProcessPool:
                self.close()
            finally:
                # After an error or an interrupt nothing more is begun.
                for future in futures:
                    future.cancel()
        labels = ", ".join(step.label for step in waiting)
        raise StepError(f"{labels}: could not be made in {_ATTEMPTS} attempts, in each of which a process died")

    def map(self, function: Callable[..., Any], *arguments: Iterable) -> Iterable:
        """As the built-in ``map``, in the processes, which begin at once.

        Raises
        ------
        StepError
            While it is gone through: processes died three times.
        """
        if self._number == 1:
            return map(function, *arguments)
        calls = list(zip(*arguments, strict=True))
        return self._results(function, calls, [self._submit(function, *call) for call in calls])

    def _results(self, function, calls, futures):
        for k in range(len(calls)):
            for attempt in range(_ATTEMPTS):
                try:
                    made = self._finished([futures[k]]).result()
                    break
                except BrokenProcessPool:
                    self.close()
                    if attempt + 1 == _ATTEMPTS:
                        raise StepError(
                            f"call {k + 1} of {len(calls)} could not be made in {_ATTEMPTS} attempts, in each of which "
                            "a process died"
                        ) from None
                    futures[k:] = [self._submit(function, *call) for call in calls[k:]]
            yield made

    def beside(self, function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
        """Call a function in another process; what is returned waits for its result, and calls it here if that died."""

        def result():
            try:
                return self._finished([future]).result()
            except BrokenProcessPool:
                self.close()
                return function(*arguments)

        if self._number == 1:
            return lambda: function(*arguments)
        future = self._submit(function, *arguments)
        return result

    def close(self) -> None:
        """End the processes; they begin anew when they are needed."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(cancel_futures=True)

    def _finished(self, futures: Iterable[Future]) -> Future:
        """The first of them that is finished.

        Raises
        ------
        BrokenProcessPool
            A process died, and the pool does not see it: it waits for the rest of what that one was writing.
        """
        are_missed = False
        while True:
            done, _ = wait(futures, timeout=_WATCH, return_when=FIRST_COMPLETED)
            if done:
                return next(iter(done))
            pool, misses = self._pool, are_missed
            are_missed = pool is None or not all(process.is_alive() for process in list(pool._processes.values()))
            if are_missed and misses:
                if pool is not None:
                    self._pool = None
                    endExecutor(pool)
                raise BrokenProcessPool("a process died while it wrote its result")

    def _submit(self, function, *arguments):
        if self._pool is None:
            self._pool = processes(self._number)()
        try:
            return self._pool.submit(function, *arguments)
        except BrokenProcessPool:
            # One died while it had nothing to do.
            self.close()
            self._pool = processes(self._number)()
            return self._pool.submit(function, *arguments)


def _begin(payload):
    study = load(payload)
    SeparationFunction(study.problem.getCase()).evaluate([study.problem.getDistribution().getMean()])


def _payload(study):
    return zlib.compress(pickle.dumps(study), 1)


def _make(payload, step):
    return step.make(load(payload))
