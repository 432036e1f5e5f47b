"""The subcommands of `sitl-sim`, one module each.

A module has `HELP`, `add_arguments(parser)` and `run(options) -> exit status`. It imports what
it needs inside `run`, so that `sitl-sim --help` answers at once.
"""
