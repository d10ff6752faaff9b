"""The scatter of uncertain inputs in words."""

from collections.abc import Sequence

from satsep_ot.model.distributions import interval_digits
from satsep_ot.model.inputs import UncertainInput
from satsep_ot.studies.telling.words import with_space


def describe_scatter(row: UncertainInput) -> str:
    """The scatter of an uncertain input in words, with its unit.

    Parameters
    ----------
    row : :class:`satsep_ot.model.inputs.UncertainInput`

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.scatter import describe_scatter
    >>> describe_scatter(load_case("reference").inputs[0])
    'sigma 0.5 kg'
    >>> describe_scatter(load_case("reference").inputs[-1])
    '0 to 2 ms, uniform'
    """
    distribution, kind = row.distribution, _kind(row)
    unit = with_space(row.unit)
    if kind == "Normal":
        return f"sigma {distribution.getStandardDeviation()[0]:.3g}{unit}"
    if kind == "Uniform":
        low, high = distribution.getParameter()
        digits = interval_digits(low, high)
        return f"{low:.{digits}g} to {high:.{digits}g}{unit}, uniform"
    return f"{distribution}{unit}"


def _kind(row):
    return row.distribution.getImplementation().getClassName()


def describe_scatters(rows: Sequence[UncertainInput]) -> str:
    """The scatter of all inputs of a tolerance, each different one once.

    Parameters
    ----------
    rows : sequence of :class:`satsep_ot.model.inputs.UncertainInput`

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.scatter import describe_scatters
    >>> describe_scatters([row for row in load_case("reference").inputs if row.entry == "stiffness"])
    'sigma 55 N/m'
    """
    texts = dict.fromkeys(map(describe_scatter, rows))
    if len(texts) > 2 and all(_kind(row) == "Normal" for row in rows):
        deviations = [row.distribution.getStandardDeviation()[0] for row in rows]
        return f"sigma {min(deviations):.3g} to {max(deviations):.3g}{with_space(rows[0].unit)}"
    return "; ".join(texts)


def describe_inputs(rows: Sequence[UncertainInput]) -> str:
    """What the inputs of a tolerance are, in words.

    Parameters
    ----------
    rows : sequence of :class:`satsep_ot.model.inputs.UncertainInput`

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.scatter import describe_inputs
    >>> describe_inputs([row for row in load_case("reference").inputs if row.entry == "stiffness"])
    'stiffness of springs 1, 2, 3, 4'
    """
    if len(rows) > 1 and rows[0].series and len({row.series for row in rows}) == 1:
        return f"{rows[0].series} {', '.join(str(row.number) for row in rows)}"
    return "; ".join(dict.fromkeys(row.description for row in rows))
