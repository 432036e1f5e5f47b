"""Coverage-guided fuzzing of one target with atheris: `python tests/fuzz/guided.py codec`.

Options after the target's name go to libFuzzer, e.g. `-max_total_time=600`. It starts from the
corpus, writes new inputs to a temporary folder and failing inputs to `crash-…` in the working
folder. It needs the extra `fuzz`.
"""

import json
import os
import sys
import tempfile
import warnings

import atheris

OURS = ["companion", "mavlink_bridge", "sitl_sim"]  # packages whose coverage guides it
os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiled code has no coverage

with atheris.instrument_imports(include=OURS):
    from tests.fuzz import targets


def main():
    """Fuzz until it is stopped."""
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
