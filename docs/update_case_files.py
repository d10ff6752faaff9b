"""Write the tables of keys of docs/case-files.md anew, from the table of parameters of the package.

python docs/update_case_files.py
"""

from pathlib import Path

from satsep_ot.model.parameters import TABLES, elements, parameter_rows
from satsep_ot.model.rows import CaseTable, Row

PAGE = Path(__file__).parent / "case-files.md"


def key_table(table: CaseTable) -> str:
    """The keys of one table of the case file, in Markdown."""
    lines = ["| key | unit | default | meaning |", "|---|---|---|---|"]
    for row in table.rows:
        meaning = f"{row.meaning}; {row.value.range}" if row.value.range else row.meaning
        lines.append(f"| `{row.key}` | {row.unit.name} | {row.shown_default()} | {meaning} |")
    return "\n".join(lines)


def scatter_table() -> str:
    """What may scatter, in Markdown."""
    lines = ["| `quantity` | unit | where |", "|---|---|---|"]
    for table, row in parameter_rows():
        lines.append(f"| {_quantity(table, row)} | {row.unit.label} | {row.only} |")
    return "\n".join(lines)


def _quantity(table, row: Row):
    key = f"{table.name}.{row.key}"
    if row.holder == "springs":
        return f"`{key}`, `{key}.1`, ..., `{key}.each`"
    if row.holder in ("recess_planes", "hold_downs"):
        return f"`{table.name}.1.{row.key}`, ..."
    first, *others = elements(row)
    if not first:
        return f"`{key}`"
    return f"`{key}.{first}` ({', '.join(f'`{element}`' for element in others)})"


def written(page: str) -> str:
    """The page with its tables of keys as they are now: what stands between two marks is replaced."""
    # The satellite has the keys of the platform.
    tables = {
        f"keys of {name or 'the file'}": key_table(table) for name, table in TABLES.items() if name != "satellite"
    }
    for name, text in {**tables, "what may scatter": scatter_table()}.items():
        marks = f"<!-- {name}: begin -->\n", f"\n<!-- {name}: end -->"
        start, end = page.index(marks[0]) + len(marks[0]), page.index(marks[1])
        page = page[:start] + text + page[end:]
    return page


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
