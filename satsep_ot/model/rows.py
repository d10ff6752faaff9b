"""What a row of the table of keys is: `Row` for a key of the case file, `CaseTable` for one of its tables."""

from dataclasses import dataclass, field
from typing import Any

from satsep_ot.model.values import Unit, Value


class _Default:
    """A default that is no value of the file."""

    def __init__(self, name):
        self.name = name

    def __repr__(self):
        return self.name


NEEDED = _Default("needed")  # the key cannot be left out
ABSENT = _Default("none")  # without the key there is nothing, or another key says it


@dataclass(frozen=True)
class Row:
    """One key of the case file.

    Parameters
    ----------
    key : str
    value : Value
        Its kind, with unit and range.
    meaning : str
        One sentence or less, for the documentation and for editors.
    default : optional
        In the unit of the file; NEEDED if the key must be given, ABSENT if it has no value by default.
    default_note : str
        In place of the default where the documentation has more to say.
    field : str
        Path of the parameter from the separation on, for example "springs.stroke"; empty for what is no parameter.
    scatters : str
        What an uncertain input of it is called, with "{element}" for an axis or an element of a tensor; empty if it may
        not scatter.
    only : str
        Where it plays a part, in words; empty for everywhere.
    of_connector : tuple of int
        Which of the two springs of an umbilical connector hold the parameter: its spring is 0, its pins are 1.
    usual : (float, float)
        The smallest and the largest value of any real separation, in the unit of the file.
    smallest_scatter : float, optional
        The smallest credible scatter in the unit of the file, where it differs from `Unit.smallest_scatter`.
    is_lateral : bool
        Whether its x and z are one physical tolerance, across the separation axis.
    """

    key: str
    value: Value
    meaning: str
    default: Any = NEEDED
    default_note: str = ""
    field: str = ""
    scatters: str = ""
    only: str = ""
    of_connector: tuple[int, ...] = ()
    usual: tuple[float, float] | None = None
    smallest_scatter: float | None = None
    is_lateral: bool = False

    @property
    def unit(self) -> Unit:
        """The unit in the file."""
        return self.value.unit

    @property
    def holder(self) -> str:
        """What of the separation holds the parameter: "springs", a body, or the field itself."""
        return self.field.partition(".")[0]

    @property
    def is_of_separation(self) -> bool:
        """Whether the parameter is a field of the separation itself, not of a body, of springs or of planes."""
        return self.field != "" and self.holder == self.field

    @property
    def parameter(self) -> str:
        """The name of the parameter in what holds it, for example "stroke"."""
        return self.field.rpartition(".")[2]

    def shown_default(self) -> str:
        """The default as the documentation writes it."""
        if self.default_note or isinstance(self.default, _Default):
            return self.default_note or repr(self.default)
        if isinstance(self.default, bool):
            return f"`{str(self.default).lower()}`"
        return f'`"{self.default}"`' if isinstance(self.default, str) else f"`{_plain(self.default)}`"


def _plain(default):
    if isinstance(default, tuple):
        return f"[{', '.join(_plain(value) for value in default)}]"
    return f"{default:.10g}"


@dataclass(frozen=True)
class CaseTable:
    """One table of the case file.

    Parameters
    ----------
    name : str
        As its heading has it; empty for the keys at the top.
    meaning : str
    rows : tuple of Row
    is_needed : bool
    is_list : bool
        Whether there may be several, each headed [[name]].
    conditions : dict
        What the JSON Schema says of its keys together.
    """

    name: str
    meaning: str
    rows: tuple[Row, ...]
    is_needed: bool = False
    is_list: bool = False
    conditions: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, key: str) -> Row:
        return next(row for row in self.rows if row.key == key)

    @property
    def keys(self) -> list[str]:
        """The keys in the order of the table."""
        return [row.key for row in self.rows]
