"""The commands of `satsep-ot`, one module each.

A command has a name, a summary and examples for its help, `add_arguments`, `run`, which returns an exit code (None for
0), and `left_behind`, which says what an interrupted command leaves. Only `run` loads libraries, so that help is quick.
"""
