"""How many lines of what decides and of what reads the wire no unit test reaches: `make coverage`.

The counts are bounds: a change that leaves more lines out fails. Lower them when fewer are missed.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

MISSED = {  # lines at most
    "companion/supervision": 78,
    "companion/estimation": 56,
    "companion/guidance": 19,
    "mavlink_bridge/wire": 56,
}
# Generated, and what the tests of processes reach.
LEFT_OUT = ("mavlink_bridge/wire/dialect/common.py", "mavlink_bridge/wire/video.py")
TESTS = ("tests/companion/supervision", "tests/companion/estimation", "tests/companion/guidance",
         "tests/mavlink_bridge/wire")  # fmt: skip
# Searches of whole state spaces, and tests of what reading costs: slow while lines are counted.
NOT_RUN = "not model and not flood and not bounded_time and not in_proportion and not displaces"


def main():
    coverage = [sys.executable, "-m", "coverage"]
    with tempfile.TemporaryDirectory() as folder:
        data = ["--data-file", f"{folder}/data"]
        source = f"--source={','.join(MISSED)}"
        tests = [
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-m",
            "not slow",
            "-k",
            NOT_RUN,
            *TESTS,
        ]
        ran = subprocess.run(
            [*coverage, "run", *data, source, f"--omit={','.join(LEFT_OUT)}", *tests]
        )
        if ran.returncode:
            return ran.returncode
        file = Path(folder) / "found.json"
        subprocess.run([*coverage, "json", "-q", *data, "-o", file], check=True)
        files = json.loads(file.read_text(encoding="utf-8"))["files"]
    failed = False
    for wing, most in MISSED.items():
        mine = [f["summary"] for name, f in files.items() if name.startswith(f"{wing}/")]
        missed, lines = (sum(f[key] for f in mine) for key in ("missing_lines", "num_statements"))
        assert lines, f"{wing}: no line was counted"
        print(f"{wing}: {missed} of {lines} lines missed, at most {most}")
        failed |= missed > most
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
