"""Mutation testing: `make mutants` runs a sample of mutants of each wing, by seed.

mutmut makes the mutants, finds by a run of the tests which of them reach a function, and runs
these for each mutant. What has been run keeps its result in `mutants/`; the same command goes on
where it was stopped. A mutant of which only a text differs is not drawn: words are no behaviour.
"""

import argparse
import difflib
import json
import random
import re
import subprocess
import sys
from pathlib import Path

WINGS = ("companion/supervision", "companion/estimation", "companion/guidance",
         "mavlink_bridge/wire")  # fmt: skip
MUTANTS = Path("mutants")
MUTMUT = Path(sys.executable).with_name("mutmut")
# Exit codes of mutmut: the tests failed, or ran out of time, or died.
_KILLED, _SURVIVED, _UNTESTED = (1, 3, 24, 36, -24, 152, 255), 0, (5, 33)
_TEXT = re.compile(r"""[rfb]*("(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*')""")


def results(wing):
    """Exit code by mutant, None where it has not been run."""
    found = {}
    for path in sorted((MUTANTS / wing).rglob("*.meta")):
        found |= json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
    return found


class Sources:
    """The code of each mutant, as mutmut has written it beside the code that it comes from."""

    def __init__(self):
        self._lines = {}

    def diff(self, mutant):
        """The lines that differ, (before, after)."""
        module, _, function = mutant.rpartition(".")
        before = self._function(module, re.sub(r"__mutmut_\d+$", "__mutmut_orig", function))
        after = self._function(module, function)
        lines = [*difflib.unified_diff(before, after, lineterm="", n=0)][3:]
        gone = [line[1:].strip() for line in lines if line.startswith("-")]
        come = [line[1:].strip() for line in lines if line.startswith("+")]
        # The function's name is another in each.
        return [line for line in gone if "__mutmut_" not in line], [
            line for line in come if "__mutmut_" not in line
        ]

    def only_text(self, mutant):
        """Whether the two differ within quotation marks only."""
        before, after = ("\n".join(lines) for lines in self.diff(mutant))
        return before != after and _TEXT.sub('""', before) == _TEXT.sub('""', after)

    def _function(self, module, name):
        path = MUTANTS / Path(*module.split(".")).with_suffix(".py")
        if path not in self._lines:
            self._lines[path] = path.read_text(encoding="utf-8").splitlines()
        lines = self._lines[path]
        head = re.compile(rf"^(\s*)(?:async )?def {re.escape(name)}\(")
        start = next(n for n, line in enumerate(lines) if head.match(line))
        indent = len(head.match(lines[start]).group(1))
        end = start + 1
        while end < len(lines) and (
            not lines[end].strip()
            or len(lines[end]) - len(lines[end].lstrip()) > indent
            or lines[end].strip().startswith(")")
        ):
            end += 1
        return [line.rstrip() for line in lines[start:end]]


def sample(wing, count, seed):
    """`count` mutants of a wing; a larger count holds those of a smaller one."""
    names, sources = sorted(results(wing)), Sources()
    random.Random(f"{wing} {seed}").shuffle(names)
    drawn = []
    for name in names:
        if len(drawn) == count:
            break
        if not sources.only_text(name):
            drawn.append(name)
    return drawn


def mutmut(names):
    """Run these mutants; return whether mutmut ended well."""
    command = [MUTMUT, "run", "--max-children", "1", *names]
    with (MUTANTS / "log").open("w") as log:
        return subprocess.run(command, stdout=log, stderr=subprocess.STDOUT).returncode == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40, help="mutants of each wing")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--batch", type=int, default=20, help="mutants between two reports")
    parser.add_argument("--again", action="store_true", help="run survivors again")
    options = parser.parse_args()
    MUTANTS.mkdir(exist_ok=True)
    # Mutants are made, and tests are mapped to functions, by a run of one that is quick.
    if not mutmut(["companion.supervision.last_resort.xǁLastResortǁ__init____mutmut_1"]):
        print(f"mutmut failed: see {MUTANTS}/log", file=sys.stderr)
        return 2
    drawn = {wing: sample(wing, options.count, options.seed) for wing in WINGS}
    for wing, names in drawn.items():
        known = results(wing)
        again = (None, _SURVIVED, *_UNTESTED) if options.again else (None,)
        due = [name for name in names if known[name] in again]
        for n in range(0, len(due), options.batch):
            mutmut(due[n : n + options.batch])
            print(f"{wing}: {min(n + options.batch, len(due))} of {len(due)} run", flush=True)
    return report(drawn)


def report(drawn):
    """Print the table and the survivors."""
    sources, left, unclear = Sources(), [], 0
    print(
        "\n| wing | mutants | drawn | killed | survived | not reached |\n|---|---|---|---|---|---|"
    )
    for wing, names in drawn.items():
        found = results(wing)
        codes = [found[name] for name in names]
        killed = sum(code in _KILLED for code in codes)
        survived, untested = codes.count(_SURVIVED), sum(code in _UNTESTED for code in codes)
        unclear += len(codes) - killed - survived - untested
        print(f"| {wing} | {len(found)} | {len(names)} | {killed} | {survived} | {untested} |")
        left += [name for name in names if found[name] in (_SURVIVED, *_UNTESTED)]
    for name in left:
        before, after = (" / ".join(lines) for lines in sources.diff(name))
        print(f"\n{name}\n  - {before}\n  + {after}")
    if unclear:
        print(f"\n{unclear} with another outcome (a signal, say): {MUTANTS}/**/*.meta")
    return 1 if unclear else 0


if __name__ == "__main__":
    sys.exit(main())
