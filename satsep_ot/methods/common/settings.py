"""Defaults that users can set as OpenTURNS' own: keys ``SatsepOT-...`` of :py:class:`openturns.ResourceMap`."""

import openturns as ot

_PREFIX = "SatsepOT-"
# Key without the prefix -> default, and what it is. docs/user-guide.md lists them, kept by a test.
SETTINGS: dict[str, tuple[int | float, str]] = {
    "ActiveSubspaceAlgorithm-BootstrapSize": (1000, "bootstrap replicates with up to 50 inputs"),
    "ActiveSubspaceAlgorithm-SamplingFactor": (60.0, "gradients over the logarithm of the number of inputs"),
    "ActiveSubspaceAlgorithm-MaximumSamplingRatio": (10, "largest number of gradients over the default one"),
    "MultivariatePolynomialRegression-Degree": (4, "total degree"),
    "MultivariatePolynomialRegression-HyperbolicNorm": (1.0, "norm of the index set"),
    "RidgeApproximation-LargestDimension": (3, "largest dimension of the automatic choice"),
    "RidgeApproximation-LargestDegree": (4, "largest degree of the automatic choice"),
    "RidgeApproximation-StartsNumber": (2, "random starts beside those from the quadratic fit"),
    "RidgeApproximation-FoldsNumber": (5, "folds of the cross-validation"),
    "MonteCarloStream-BlockSize": (1024, "runs of a block"),
}


def setting(name: str) -> int | float:
    """The value of a setting: what the user has put into the resource map, else its default.

    Parameters
    ----------
    name : str
        A key of `SETTINGS`.

    Raises
    ------
    ValueError
        What stands in the resource map is no number of the right kind.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.settings import setting
    >>> setting("RidgeApproximation-FoldsNumber")
    5
    >>> ot.ResourceMap.SetAsUnsignedInteger("SatsepOT-RidgeApproximation-FoldsNumber", 10)
    >>> setting("RidgeApproximation-FoldsNumber")
    10
    >>> ot.ResourceMap.SetAsUnsignedInteger("SatsepOT-RidgeApproximation-FoldsNumber", 5)
    """
    default, _ = SETTINGS[name]
    key = _PREFIX + name
    if not ot.ResourceMap.HasKey(key):
        return default
    # A key that a script adds before this package is there may be text.
    text = ot.ResourceMap.Get(key)
    try:
        return type(default)(text)
    except ValueError as error:
        raise ValueError(f"the resource map has {key} = {text!r}; it must be a number like {default}") from error


def register() -> None:
    """Put the defaults into the resource map, so that it lists them; what is there already stays."""
    for name, (default, _) in SETTINGS.items():
        if not ot.ResourceMap.HasKey(_PREFIX + name):
            add = ot.ResourceMap.AddAsUnsignedInteger if isinstance(default, int) else ot.ResourceMap.AddAsScalar
            add(_PREFIX + name, default)


register()
