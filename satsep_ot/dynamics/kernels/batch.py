"""Many runs, one after the other, and the sweeps back through them: what Python calls."""

from typing import Any

from numba import njit

from satsep_ot.dynamics.kernels.adjoint import sweep_run
from satsep_ot.dynamics.kernels.compilation import KERNEL, SOURCE_DIGEST, entry_point, kernel
from satsep_ot.dynamics.kernels.deck import set_notice
from satsep_ot.dynamics.kernels.integration import copy_state, forget_slopes
from satsep_ot.dynamics.kernels.records import LANES, Gradients, Parameters, Run, Sweep
from satsep_ot.dynamics.kernels.run import fly
from satsep_ot.dynamics.kernels.status import OK, PENETRATION


# Numba returns no records: these two become part of the functions that call them.
@njit(inline="always", **KERNEL)
def run_of(buffers, slot):
    """The run in a slot."""
    return Run(
        buffers.systems[slot], buffers.springs[slot], buffers.cubics, buffers.points[slot], buffers.planes[slot],
        buffers.tapes[slot], buffers.steps[0], buffers.progress[0],
    )  # fmt: skip


@njit(inline="always", **KERNEL)
def parameters_of(row, buffers):
    """The parameters of a run, from their flat vector."""
    read_parameters(row, buffers.parameters[0], buffers.spring_parameters, buffers.offsets)
    return Parameters(row, buffers.limits, buffers.parameters[0], buffers.spring_parameters, buffers.offsets)


@kernel
def read_parameters(row, common, springs, offsets):
    """Take a flat vector of parameters apart."""
    k = 0
    for n in range(common.x.shape[0]):
        common.x[n] = row[k]
        k += 1
    for i in range(springs.shape[0]):
        for n in range(springs[i].x.shape[0]):
            springs[i].x[n] = row[k]
            k += 1
    for i in range(offsets.shape[0]):
        offsets[i] = row[k]
        k += 1


@kernel
def write_gradient(gradients, n, row):
    """The flat vector of gradient n."""
    k = 0
    for m in range(gradients.common[n].x.shape[0]):
        row[k] = gradients.common[n].x[m]
        k += 1
    for i in range(gradients.springs.shape[1]):
        for m in range(gradients.springs[n, i].x.shape[0]):
            row[k] = gradients.springs[n, i].x[m]
            k += 1
    for i in range(gradients.offsets.shape[1]):
        row[k] = gradients.offsets[n, i]
        k += 1


def _entry_points(source_digest: int) -> Any:
    """The compiled batch runs, kept on disk under keys that contain the digest of the sources."""

    @entry_point
    def run_rows(
        first, end, keep, rows, orbit, attitude, horizon, tolerance, stops, buffers, results, exit_clearances,
        release_time, status, steps, evaluations, last, states, notices,
    ):  # fmt: skip
        """Rows first to end - 1 of the parameters, one after the other; with keep = 1 each in a slot of its own.

        Writes a RESULT for each, the clearances of its points at their exits (n, E), release times (n, N), status,
        numbers of steps and of evaluations of the right-hand side, the index of the tape's state at the last release,
        the states at the times `stops`, and a NOTICE.
        """
        digest = source_digest  # noqa: F841 a closure variable enters the cache key only where it is used
        for row in range(first, end):
            run = run_of(buffers, (row - first) * keep)
            parameters = parameters_of(rows[row], buffers)
            status[row] = fly(
                parameters, orbit, attitude, stops, horizon, tolerance, run, release_time[row], states[row]
            )  # fmt: skip
            steps[row] = run.progress.step
            evaluations[row] = run.progress.evaluations
            last[row] = run.progress.last
            result, end_of_push = results[row], run.tape[run.progress.last]
            copy_state(end_of_push.state, result.state)
            result.time = end_of_push.time
            result.clearance = run.system.closest.clearance
            result.deck_height = run.system.deck.height
            if status[row] == PENETRATION:
                set_notice(notices[row], run)
            for i in range(run.points.shape[0]):
                exit_clearances[row, i] = run.points[i].exit_clearance

    @entry_point
    def sweep_rows(first, end, rows, buffers, status, last, outputs, gradients):
        """Gradients (n, len(outputs), P) of outputs, a multiple of LANES, of the runs in the slots."""
        digest = source_digest  # noqa: F841
        sweep = Sweep(buffers.chains[0], buffers.spring_adjoints, buffers.offset_adjoints)
        blocks = Gradients(buffers.gradients, buffers.spring_gradients, buffers.offset_gradients)
        # What an earlier run left there may be infinite, and 0 times infinity is no number.
        forget_slopes(buffers.steps[0])
        for row in range(first, end):
            if status[row] == OK:
                run = run_of(buffers, row - first)
                parameters = parameters_of(rows[row], buffers)
                for block in range(0, outputs.shape[0], LANES):
                    sweep_run(outputs[block : block + LANES], last[row], parameters, run, sweep, blocks)
                    for n in range(LANES):
                        write_gradient(blocks, n, gradients[row, block + n])

    return run_rows, sweep_rows


run_rows, sweep_rows = _entry_points(SOURCE_DIGEST)
