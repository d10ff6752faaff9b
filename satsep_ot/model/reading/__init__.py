"""From the TOML text of a case to its parts: one module for each part, on top of `table`, which words every refusal."""
