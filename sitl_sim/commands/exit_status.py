"""Exit statuses of `sitl-sim`."""

EXIT_OK = 0
EXIT_FELL_SHORT = 1  # flown, and fell short of what was asked for
EXIT_BAD_INPUT = 2  # nothing flown: the input cannot be used, or an extra is missing
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as a shell reports it
