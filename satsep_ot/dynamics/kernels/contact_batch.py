"""Many runs with contact, one after the other, and the sweeps back through them: what Python calls."""

from typing import Any

from numba import njit

from satsep_ot.dynamics.kernels.batch import read_parameters, write_gradient
from satsep_ot.dynamics.kernels.compilation import KERNEL, SOURCE_DIGEST, entry_point, kernel
from satsep_ot.dynamics.kernels.contact_adjoint import sweep_run_with_contact
from satsep_ot.dynamics.kernels.contact_run import fly_with_contact
from satsep_ot.dynamics.kernels.integration import copy_state, forget_slopes
from satsep_ot.dynamics.kernels.records import (
    LANES,
    ContactGradients,
    ContactParameters,
    ContactRun,
    ContactSweep,
)
from satsep_ot.dynamics.kernels.status import OK


@njit(inline="always", **KERNEL)
def run_of(buffers, more, slot):
    """The run in a slot."""
    return ContactRun(
        buffers.systems[slot], buffers.springs[slot], buffers.cubics, buffers.points[slot], buffers.planes[slot],
        buffers.tapes[slot], buffers.steps[0], buffers.progress[0], more.elements[slot], more.contacts[slot],
        more.events[slot],
    )  # fmt: skip


@njit(inline="always", **KERNEL)
def parameters_of(row, buffers, more):
    """The parameters of a run, from their flat vector."""
    read_parameters(row, buffers.parameters[0], buffers.spring_parameters, buffers.offsets)
    first = row.shape[0] - more.contact.shape[0] * 8 - more.rails.shape[0] * 11 - more.hold_downs.shape[0] * 6
    first = read_records(row, first, more.contact)
    first = read_records(row, first, more.rails)
    read_records(row, first, more.hold_downs)
    return ContactParameters(
        row, buffers.limits, buffers.parameters[0], buffers.spring_parameters, buffers.offsets, more.contact,
        more.rails, more.hold_downs,
    )  # fmt: skip


@kernel
def read_records(row, first, records):
    """Take records from the flat vector, from `first` on; returns where the next ones stand."""
    for i in range(records.shape[0]):
        for n in range(records[i].x.shape[0]):
            records[i].x[n] = row[first]
            first += 1
    return first


@kernel
def write_records(row, first, records, n):
    """Put gradient n of records into the flat vector, from `first` on; returns where the next ones stand."""
    for i in range(records.shape[1]):
        for m in range(records[n, i].x.shape[0]):
            row[first] = records[n, i].x[m]
            first += 1
    return first


def _entry_points(source_digest: int) -> Any:
    """The compiled batch runs, kept on disk under keys that contain the digest of the sources."""

    @entry_point
    def run_contact_rows(
        first, end, keep, rows, orbit, attitude, horizon, tolerance, stops, buffers, more, results, exit_clearances,
        release_time, status, steps, evaluations, last, states, contacts,
    ):  # fmt: skip
        """As `batch.run_rows`; `contacts` (n, 3) are impulse, largest force and end of the last contact."""
        digest = source_digest  # noqa: F841
        for row in range(first, end):
            run = run_of(buffers, more, (row - first) * keep)
            parameters = parameters_of(rows[row], buffers, more)
            status[row] = fly_with_contact(
                parameters, orbit, attitude, stops, horizon, tolerance, run, release_time[row], states[row],
                more.angles, more.feet,
            )  # fmt: skip
            steps[row] = run.progress.step
            evaluations[row] = run.progress.evaluations
            last[row] = run.progress.last
            result, at_last = results[row], run.tape[run.progress.last]
            copy_state(at_last.state, result.state)
            result.time = at_last.time
            result.clearance = run.system.closest.clearance
            result.deck_height = run.system.deck.height
            contacts[row, 0] = run.contact.impulse
            contacts[row, 1] = run.contact.force
            contacts[row, 2] = run.contact.last_contact
            for i in range(run.points.shape[0]):
                exit_clearances[row, i] = run.points[i].exit_clearance

    @entry_point
    def sweep_contact_rows(first, end, rows, buffers, more, status, steps, last, outputs, gradients):
        """As `batch.sweep_rows`."""
        digest = source_digest  # noqa: F841
        sweep = ContactSweep(
            buffers.chains[0], buffers.spring_adjoints, buffers.offset_adjoints, more.element_adjoints
        )  # fmt: skip
        blocks = ContactGradients(
            buffers.gradients, buffers.spring_gradients, buffers.offset_gradients, more.contact_gradients,
            more.rail_gradients, more.hold_gradients,
        )  # fmt: skip
        forget_slopes(buffers.steps[0])
        for row in range(first, end):
            if status[row] == OK:
                run = run_of(buffers, more, row - first)
                parameters = parameters_of(rows[row], buffers, more)
                for block in range(0, outputs.shape[0], LANES):
                    sweep_run_with_contact(
                        outputs[block : block + LANES], steps[row], last[row], parameters, run, sweep, blocks,
                        more.angles, more.feet,
                    )  # fmt: skip
                    for n in range(LANES):
                        write_gradient(blocks, n, gradients[row, block + n])
                        first_more = rows.shape[1] - (
                            more.contact.shape[0] * 8 + more.rails.shape[0] * 11 + more.hold_downs.shape[0] * 6
                        )
                        first_more = write_records(gradients[row, block + n], first_more, more.contact_gradients, n)
                        first_more = write_records(gradients[row, block + n], first_more, more.rail_gradients, n)
                        write_records(gradients[row, block + n], first_more, more.hold_gradients, n)

    return run_contact_rows, sweep_contact_rows


run_contact_rows, sweep_contact_rows = _entry_points(SOURCE_DIGEST)
