"""The subcommands of `sitl-sim`."""
