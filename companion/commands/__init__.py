"""The subcommands of `companion`, one module each; `extras` serves them all.

A subcommand has `HELP`, `add_arguments(parser)` and `run(options) -> exit status`. It imports
what it needs inside `run`, so that `companion --help` answers at once.
"""
