"""One target under atheris, which follows the coverage: `python tests/fuzz/guided.py codec`.

What follows the target's name goes to libFuzzer: `-max_total_time=600`. It begins with the corpus
beside it; what it finds goes to a folder of its own, and what breaks the target to `crash-…` here.
Needs the extra `fuzz`.
"""

import json
import os
import sys
import tempfile
import warnings

import atheris

OURS = ["companion", "mavlink_bridge", "sitl_sim"]  # whose coverage is followed
os.environ["NUMBA_DISABLE_JIT"] = "1"  # nothing compiled can be followed

with atheris.instrument_imports(include=OURS):
    from tests.fuzz import targets


def main():
    """Fuzz until told to stop."""
    name = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    if name not in targets.TARGETS:
        usage = {"usage": "guided.py TARGET [libFuzzer options]", "targets": list(targets.TARGETS)}
        sys.exit(json.dumps(usage))
    warnings.simplefilter("error")
    found = tempfile.mkdtemp(prefix=f"fuzz-{name}-")
    corpus = str(targets.CORPUS / targets.FOLDERS[name])
    atheris.Setup([*sys.argv, found, corpus], targets.TARGETS[name])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
