"""The JSON Schema of a case file, from the table of its keys: editors complete and check a case by it."""

import json
from typing import Any

from satsep_ot.model.parameters import HOLD_DOWN, INPUT, TABLES, scatter_keys
from satsep_ot.model.rows import ABSENT, NEEDED, CaseTable, Row

_DRAFT = "http://json-schema.org/draft-07/schema#"


def case_schema() -> dict[str, Any]:
    """The JSON Schema (draft 7) of a case file.

    Returns
    -------
    schema : dict
        Made for `json.dump`. It holds what can be said of each key by itself and of the keys of one table; what depends
        on several tables, and what a distribution thinks of its parameters, `load_case` says.

    Examples
    --------
    >>> from satsep_ot.model.schema import case_schema
    >>> mass = case_schema()["properties"]["satellite"]["properties"]["mass"]
    >>> mass["type"], mass["exclusiveMinimum"], mass["description"]
    ('number', 0, 'Mass of the body [kg], positive.')
    """
    schema = _table_schema(TABLES[""])
    for name, table in TABLES.items():
        if not name:
            continue
        inner = _input_schema() if table is INPUT else _table_schema(table)
        if table.is_list:
            inner = {"type": "array", "items": inner, "description": table.meaning}
        if name in ("umbilical", "hold_down"):
            # A single one is a table.
            inner = {"anyOf": [inner["items"], inner], "description": table.meaning}
        owner, _, key = name.rpartition(".")
        holder = schema["properties"][owner] if owner else schema
        holder["properties"][key] = inner
    return {
        "$schema": _DRAFT,
        "title": "Case of satsep-ot",
        **schema,
        "required": [table.name for table in TABLES.values() if table.is_needed],
    }


def case_schema_text() -> str:
    """The schema as the text of a file."""
    return json.dumps(case_schema(), indent=2) + "\n"


def _table_schema(table: CaseTable) -> dict[str, Any]:
    return {
        "type": "object",
        "description": table.meaning,
        "properties": {row.key: _row_schema(row) for row in table.rows},
        "required": [row.key for row in table.rows if row.default is NEEDED],
        "additionalProperties": False,
        **table.conditions,
    }


def _row_schema(row: Row) -> dict[str, Any]:
    schema = {**row.value.schema(), "description": _description(row)}
    if row.default is not NEEDED and row.default is not ABSENT:
        schema["default"] = list(row.default) if isinstance(row.default, tuple) else row.default
    return schema


def _description(row):
    unit = f" [{row.unit.name}]" if row.unit.name else ""
    start = row.meaning[0].upper() + row.meaning[1:]
    return f"{start}{unit}{', ' if row.value.range else ''}{row.value.range}."


def _input_schema():
    """[inputs]: one table for each input, whose further keys are the parameters of its distribution."""
    entry = _table_schema(INPUT)
    by_distribution, by_size = entry["anyOf"]
    # Only a distribution has parameters, which are further keys.
    entry["anyOf"] = [by_distribution, {**by_size, "propertyNames": {"enum": INPUT.keys}}]
    entry["additionalProperties"] = {"type": "number"}
    single, each = scatter_keys()
    words = {"enum": [*single, *(f"{key}{ending}" for key in each for ending in ("", ".each"))]}
    numbered = "|".join(key.replace(".", r"\.") for key in each)
    planes = r"envelope\.planes\.[1-9][0-9]*\.offset"
    bolts = rf"hold_down\.[1-9][0-9]*\.({'|'.join(row.key for row in HOLD_DOWN.rows if row.field)})"
    pattern = {"type": "string", "pattern": rf"^(({numbered})\.[1-9][0-9]*|{planes}|{bolts})$"}
    entry["properties"]["quantity"] |= {"anyOf": [words, pattern]}
    return {"type": "object", "description": "Uncertain inputs, one entry each.", "additionalProperties": entry}
