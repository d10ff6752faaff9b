"""What a study says of its results: verdicts, tables, figures, report."""
