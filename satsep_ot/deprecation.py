"""Public names of the version before: they stay for one version, warn, and do what the new names do.

Examples
--------
>>> import warnings
>>> from satsep_ot.deprecation import DeprecatedAlias
>>> class Result:
...     def getConverged(self):
...         return True
...     isConverged = DeprecatedAlias("getConverged")
>>> with warnings.catch_warnings(record=True) as caught:
...     warnings.simplefilter("always")
...     print(Result().isConverged(), caught[0].message)
True isConverged is deprecated since 0.2 and will be removed in 0.3: use getConverged
"""

import warnings

# Versions in which names were renamed and in which the old ones are removed.
_SINCE, _REMOVED = "0.2", "0.3"


class DeprecatedAlias:
    """A method under its old name.

    Parameters
    ----------
    new : str
        Name of the method to call instead.
    """

    def __init__(self, new: str) -> None:
        self.new = new

    def __set_name__(self, owner: type, old: str) -> None:
        new = self.new

        def alias(self, *arguments, **options):
            warnDeprecated(old, new)
            return getattr(self, new)(*arguments, **options)

        alias.__name__, alias.__qualname__ = old, f"{owner.__qualname__}.{old}"
        alias.__doc__ = f"Deprecated name of `{new}`."
        # In place of this object: whoever looks a class through finds methods.
        setattr(owner, old, alias)


def warnDeprecated(old: str, new: str) -> None:
    """Warn the caller's caller that a name is deprecated."""
    message = f"{old} is deprecated since {_SINCE} and will be removed in {_REMOVED}: use {new}"
    warnings.warn(message, DeprecationWarning, stacklevel=3)
