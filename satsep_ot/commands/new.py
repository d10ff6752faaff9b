"""`satsep-ot new`."""

import argparse
import os
from pathlib import Path

from satsep_ot.commands.printing import fail

NAME = "new"
SUMMARY = "write an annotated case file to start from, and its JSON Schema for editors"
EXAMPLES = "  satsep-ot new mine.toml\n  satsep-ot new mine.toml --like cubesat"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument("file", type=Path, metavar="FILE", help="the file to write; an existing one is not overwritten")
    parser.add_argument(
        "--like", default="reference", metavar="NAME",
        help="the case of the package to start from (default: reference, which explains every key)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int | None:
    """Write the case and its schema."""
    from satsep_ot.model.case import new_case_text, shipped_cases
    from satsep_ot.model.schema import case_schema_text
    from satsep_ot.model.spelling import did_you_mean
    from satsep_ot.model.values import Name

    if not Name().accepts(options.file.stem):
        return fail(f"{options.file}: the file and its case cannot have this name; give {Name().allowed()}", 2)
    known = shipped_cases()
    if options.like not in known:
        hint = did_you_mean(options.like, known)
        return fail(f"{options.like} is no case of the package; there are {', '.join(known)}{hint}", 2)
    # Not `with_name`, which a folder such as "." does not have.
    schema, schema_file = case_schema_text(), options.file.parent / f"{options.file.stem}.schema.json"
    if schema_file.exists() and schema_file.read_bytes() != schema.encode():
        return fail(f"{schema_file} exists already and is not overwritten; give another name", 2)
    try:
        # Editors take the schema from the first line.
        _write(options.file, f"#:schema ./{schema_file.name}\n{new_case_text(options.like, options.file.stem)}")
        if not schema_file.exists():
            _write(schema_file, schema)
    except FileExistsError as error:
        return fail(f"{error.filename} exists already and is not overwritten; give another name", 2)
    print(
        f"{options.file} written, and {schema_file.name}, by which editors complete and check it: edit it, then run\n"
        f"  satsep-ot check {options.file}"
    )
    return None


def _write(path, text):
    """Write a new file, whole or not at all."""
    from satsep_ot.methods.common.storage import namingFile

    with namingFile(path):
        # "x" leaves no moment in which a file that appears meanwhile could be lost.
        stream = path.open("x", encoding="utf-8")
        try:
            with stream:
                stream.write(text)
        except BaseException:
            path.unlink()
            raise


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return f"{options.file} is {'there' if os.path.exists(options.file) else 'not written'}"
