"""Sentences beside the numbers of a study: where methods contradict each other, what the numbers rest on and miss."""

from satsep_ot.dynamics.separation import Status as SeparationStatus
from satsep_ot.dynamics.simulation import contact_events, simulate
from satsep_ot.model.case import SYSTEM, Case
from satsep_ot.studies.telling.results import RequirementEntry, StudyResult
from satsep_ot.studies.telling.verdicts import any_violation, best_estimate, contradiction, estimate_by
from satsep_ot.studies.telling.words import (
    DESIGN_POINT_METHODS,
    METHOD_LIMITS,
    MINIMUM_BLIND_SPOT,
    NORM_BLIND_SPOTS,
    SYSTEM_BLIND_SPOT,
    TWO_SIDED_BLIND_SPOT,
    StudyMethod,
    interval_text,
    probability_text,
)

# How often the 95 % interval of ActiveSubspace held a probability that is known: (problem, repetitions, percent), as
# tests/benchmarks/reliability_coverage.py printed it.
COVERAGE = {
    "lateral rate": ("reference-lateral-rate", 200, 98.0),
    "spin": ("reference-spin", 200, 97.5),
    "any requirement": ("reference-any-requirement", 200, 99.5),
    "axial velocity": ("reference-axial-velocity", 200, 100.0),
    "clearance": ("reference-clearance", 200, 99.0),
}
_SHOWN_CONTACTS = 8
# Above this shape of the tail of the corrections' weights an interval is not reliable.
_HEAVY_TAIL = 0.7
# Probability that a failure region escapes all wide runs, at which its size is told.
_ESCAPE = 0.05
_NOT_VALIDATED = (
    "flexible bodies and sloshing",
    "contact other than at the springs' seats where the case does not ask for it (then walls hold nothing back: a "
    "clearance below 0 is a contact that the run ignores; a satellite that sinks into the deck is a violation), and "
    "small probabilities through contact, where quantities bend",
    "friction that sticks, other than that of pins and contacts that the case asks for",
    "springs whose own mass matters",
    "runs of many minutes under gravity",
)


def assumptions(case: Case) -> list[str]:
    """What the numbers of a case rest on, a sentence each."""
    separation = case.separation
    line = separation.force_line
    gravity = "There is no gravity."
    if separation.orbit is not None:
        torque = "with" if separation.gradient_torque else "without"
        gravity = f"Only the difference of gravity between the two bodies acts, {torque} the gravity-gradient torque."
    dependence = "independent" if case.copula is None else "correlated as named there, by a normal copula"
    touch = "After the command to separate they touch only the springs and connectors of the case."
    return [
        f"Both bodies are rigid. {_contact(separation) or touch}",
        f"The force line is '{line.name.lower()}': each spring pushes {line.push}. A spring has no mass, and no "
        "friction unless the case says so. It releases at the end of its stroke, once and for all.",
        gravity,
        f"The {len(case.inputs)} uncertain inputs have the distributions of the case file and are {dependence}. The "
        "probabilities are as good as these distributions, whose tails are rarely measured.",
        "Every quantity is taken at the last release unless its description says otherwise."
        if not separation.has_contact()
        else "Every quantity is taken at the last release, of springs, bolts and pins, or at the end of the last "
        "contact, whichever is later, unless its description says otherwise.",
        *_nominal_contacts(separation),
    ]


def _contact(separation):
    """What the bodies touch, the numbers that it rests on and how far these move the answer."""
    laws = {"deck": separation.contact, "rails": separation.rails}
    said = [
        f"{name}: {law.stiffness:.3g} N/m a point, restitution {law.restitution:g} at {1e3 * law.impact_speed:g} mm/s, "
        f"friction {law.friction:g}"
        for name, law in laws.items()
        if law is not None
    ]
    if separation.hold_downs is not None:
        said.append(f"{len(separation.hold_downs)} late hold-downs of {separation.hold_downs.stiffness.max():.3g} N/m")
    if not said:
        return "Pins stick and slip." if separation.has_contact() else ""
    return (
        f"They push each other by springs with damping and friction ({'; '.join(said)}). On test cases a hundred "
        "times the deck's stiffness moved velocities by up to 4e-4 of them and rates by 0.05 deg/s, a friction of 0.3 "
        "in place of none velocities by up to 1.3 % and rates by 0.6 deg/s; with a late bolt and a failed spring "
        "together the stiffness moved them by 4 %: let these numbers scatter."
    )


def _nominal_contacts(separation):
    """What touched what in the nominal run, when and how hard."""
    if not separation.has_contact():
        return
    outcome = simulate(separation)
    begins, ends = {}, {}
    for event in contact_events(separation):
        if event.what in ("is pressed", "engages"):
            begins.setdefault(event.name, event.time)
        elif event.what in ("lets go", "leaves") and event.name in begins:
            ends[event.name] = event.time
    if outcome.status[0] != SeparationStatus.OK or not begins:
        yield f"In the nominal run {'nothing touches' if not begins else outcome.explain(0)}."
        return
    force, impulse = (float(outcome.quantity(name)[0]) for name in ("contact_force", "contact_impulse"))
    shown = sorted(begins, key=begins.get)[:_SHOWN_CONTACTS]
    touches = ", ".join(f"{name} {_span(begins[name], ends.get(name))}" for name in shown)
    more = f" and {len(begins) - len(shown)} more" if len(begins) > len(shown) else ""
    yield (
        f"In the nominal run {len(begins)} points touch (first and last time in ms): {touches}{more}. The largest "
        f"normal force of a point is {force:.3g} N, the impulse of all of them {impulse:.3g} N s."
    )


def _span(begin, end):
    return f"{1e3 * begin:.3g}" if end is None else f"{1e3 * begin:.3g} to {1e3 * end:.3g}"


def remarks(result: StudyResult) -> list[str]:
    """Sentences on methods that contradict the estimate that a verdict rests on: by how much, and why."""
    entries = {entry.name: entry for entry in result.requirements}
    told = any_violation(result)
    sentences = [told.remark] if told is not None and told.remark else []
    for requirement, rows in result.rows_by_requirement().items():
        best, doubt = best_estimate(rows), contradiction(rows)
        if doubt:
            sentences.append(
                f"{requirement}: {doubt}. Either this is chance, which does it at most 1 time in 20, or one of the "
                "methods has missed failures. More runs, or another seed, show which."
            )
        interval = None if best is None else best.interval
        if best is None or interval is None or interval.probability == 0.0:
            continue
        why = SYSTEM_BLIND_SPOT if requirement == SYSTEM else _blind_spot(result, entries[requirement])
        apart = []
        for method in DESIGN_POINT_METHODS:
            row = estimate_by(method, rows)
            if row is not None and row.probability and not interval.lower <= row.probability <= interval.upper:
                difference = _difference(row.probability / interval.probability)
                apart.append(f"{method} gives {probability_text(row.probability)} ({difference})")
        if apart:
            sentences.append(
                f"{requirement}: {' and '.join(apart)}, where {best.method} gives "
                f"{probability_text(interval.probability)} ({interval_text(interval.lower, interval.upper)})"
                + (f". The reason: {why}." if why else ".")
            )
    return sentences


def limits(result: StudyResult) -> list[str]:
    """What limits the trust in the numbers of a study, a sentence or two each."""
    methods = result.sizes.methods
    sentences = [METHOD_LIMITS[method] for method in methods if method in METHOD_LIMITS]
    for requirement, diagnostics in result.diagnostics.items():
        shape = diagnostics.pareto_shape
        if shape is not None and shape > _HEAVY_TAIL:
            sentences.append(
                f"{requirement}: the weights of the corrections of ActiveSubspace have a heavy tail (Pareto shape "
                f"{shape:.2f}), so that its interval is not reliable."
            )
    if result.touched is not None:
        sentences.append(
            f"In {100.0 * result.touched:.3g} % of the runs of the sample the bodies touch each other; in "
            f"{result.sunk:,} the satellite does not come free, which counts as a violation of every requirement. "
            "Quantities bend where a contact only just happens: estimates that fit surfaces need more runs there."
        )
    elif result.sunk:
        sentences.append(
            f"In {result.sunk:,} of {result.sizes.sample:,} runs of the sample the satellite sinks more than 0.1 mm "
            "into the deck, which holds nothing back in this case. What the bodies would do then is not known: each of "
            "these runs counts as a violation of every requirement."
        )
    if len(result.processors) > 1:
        sentences.append(
            f"The Monte Carlo sample was made by processors or versions of {len(result.processors)} kinds, which round "
            f"differently: its last digits are those of none of them alone ({'; '.join(result.processors)})."
        )
    if StudyMethod.ACTIVE_SUBSPACE in methods:
        sentences.append(
            "How often the 95 % interval of ActiveSubspace holds the truth was measured on the reference case of the "
            f"package, by repeating the estimate with other seeds: {_coverage()} repetitions "
            "(tests/benchmarks/reliability_coverage.txt; test problems of other kinds in docs/benchmarks.md). It was "
            "not measured for other cases, nor for halved tolerances with their 10 %; with a finer --precision it was "
            "measured for three requirements (docs/validation.md)."
        )
    return [
        *sentences,
        "docs/validation.md of the package says what the simulator was compared with. Nothing was compared with a "
        f"measured separation. Not modelled, or not validated: {'; '.join(_NOT_VALIDATED)}.",
    ]


def audit_remarks(result: StudyResult) -> list[str]:
    """How many wide runs looked for violations that estimates lack, and what these would miss; empty without any."""
    rows = [row for row in result.rows if row.method == StudyMethod.ACTIVE_SUBSPACE]
    audited = [row for row in rows if row.audits and row.converged]
    if not audited:
        return []
    number = min(row.audits for row in audited)
    spreads = sorted(row.audit_spread for row in audited)
    spread = " to ".join(dict.fromkeys(f"{spreads[j]:.1f}" for j in (0, -1)))
    names = "each requirement" if len(audited) == len(rows) else ", ".join(row.requirement for row in audited)
    share = f"{100.0 * (1.0 - _ESCAPE ** (1.0 / number)):.2g} %"
    text = (
        "ActiveSubspace knows only what its runs have reached. For violations that its estimates lack it looked in all "
        f"directions: at least {number} wide runs for {names}, at {spread} times the spread of the inputs. A failure "
        f"region that {share} of such runs would hit escapes so many independent ones with a probability of "
        f"{100.0 * _ESCAPE:g} %, a larger one with less."
    )
    if StudyMethod.MONTE_CARLO in result.sizes.methods:
        bounds = ", ".join(
            f"{entry.name} {probability_text(crude.upper95)}"
            for entry in result.requirements
            if (crude := estimate_by(StudyMethod.MONTE_CARLO, result.rows_of(entry.name))) is not None
        )
        text += (
            f" MonteCarlo needs no surrogate: its {result.sizes.sample:,} runs reach, with 95 % confidence, every "
            f"failure region of a probability above {probability_text(3.0 / result.sizes.sample)}, and bound the "
            f"probabilities by {bounds}."
        )
    return [text]


def _blind_spot(result: StudyResult, entry: RequirementEntry) -> str | None:
    """Why a plane or a paraboloid misses violations of a requirement; None where nothing is known."""
    if entry.center is not None:
        return TWO_SIDED_BLIND_SPOT
    name = entry.quantity
    if any(quantity.part_of == name for quantity in result.quantities.values()):
        return MINIMUM_BLIND_SPOT
    return NORM_BLIND_SPOTS.get(len(result.quantities[name].norm_of))


def _difference(ratio: float) -> str:
    """How far a probability is from a better one."""
    word, factor = ("low", 1.0 / ratio) if ratio < 1.0 else ("high", ratio)
    return f"{100.0 * abs(1.0 - ratio):.0f} % too {word}" if factor < 1.5 else f"{factor:.1f} times too {word}"


def _coverage():
    return ", ".join(f"{name} {share:g} % of {repetitions}" for name, (_, repetitions, share) in COVERAGE.items())
