"""Follows a page as its reader does: runs its commands and writes its files, from top to bottom.

| in the page | here |
|---|---|
| ```` ```sh ```` | runs; the first command that fails fails the test, with the page's line |
| ```` ```python ```` | runs as a script |
| a block with `title="FILE"` behind its language | is written into FILE |
| `<!-- runs until: TEXT -->` before `sh` | goes on when it has said TEXT; at the end Ctrl-C |
| `<!-- exits: 1 -->` before `sh` | must end with this exit status |
| `<!-- not run: REASON -->` before a block | is for readers only |

The folder, variables and functions of one block are there in the next. `pip install FOLDER`
installs beside the environment under test, without a network; its build backend must be in it.
"""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
_FENCE = re.compile(r"(?P<ticks>```+)(?P<language>\w+)?(?: title=\"(?P<file>[^\"]+)\")?\s*")
_ORDER = re.compile(r"<!-- (not run|runs until|exits): (.+) -->\s*")
_END = "END-OF-BLOCK"
_SOURCE = 'source "$1"; source "$2"'
_RUN = {"sh": "", "python": f"python <<'{_END}'"}


def script(page: Path) -> str:
    """The page as a shell script with the same lines, so that an error names the page's line."""
    lines, order = [], None
    ticks = None  # of the block that the line is in
    start = None  # of that block in the script; None: the block is not run
    for number, line in enumerate(page.read_text("utf-8").splitlines(), 1):
        fence = _FENCE.fullmatch(line)
        if ticks is None and fence:
            ticks, start = fence["ticks"], _start(fence, order, f"{page.name}:{number}")
            lines.append(start or "")
        elif ticks is None:
            order = _ORDER.fullmatch(line) or (order if not line.strip() else None)
            lines.append("")
        elif line.strip() == ticks:
            lines.append(_END if start and start.endswith(f"<<'{_END}'") else "")
            ticks = order = None
        else:
            lines.append("" if start is None else line)
    assert ticks is None, f"{page}: a block does not end"
    return "\n".join(lines) + "\n"


def _start(fence, order, where):
    """What stands in the script for the first line of a block; None: the block is not run."""
    language, file = fence["language"], fence["file"]
    what, argument = order.groups() if order else (None, "")
    if what == "not run":
        return None
    if file:
        return f"mkdir -p \"$(dirname '{file}')\" && cat > '{file}' <<'{_END}'"
    if what is not None:
        assert language == "sh", f"{where}: '{what}' is for ```sh"
        quoted = argument.replace("'", "'\\''")
        return f"{what.replace(' ', '_')} '{quoted}' <<'{_END}'"
    return _RUN.get(language)


def follow(page: Path, folder: Path) -> str:
    """Follow a page in an empty folder; return what its commands printed."""
    commands = folder / f".{page.name}"
    commands.write_text(script(page), "utf-8")
    followed = subprocess.Popen(
        ["bash", "-c", _SOURCE, "bash", Path(__file__).with_suffix(".sh"), commands],
        cwd=folder, env=_environment(page, folder), text=True, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    try:
        said, _ = followed.communicate()
    finally:
        if followed.poll() is None:  # the test ran out of time
            os.killpg(followed.pid, signal.SIGINT)
            try:
                followed.communicate(timeout=20)
            except subprocess.TimeoutExpired:
                os.killpg(followed.pid, signal.SIGKILL)
                followed.communicate()
    assert followed.returncode == 0, said[-4000:]
    return said


def _environment(page, folder):
    beside = folder / ".site"
    path = [str(Path(sys.executable).parent), os.environ["PATH"]]
    return os.environ | {
        "PAGE": str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else page.name,
        "PATH": os.pathsep.join(path),
        "PYTHONPATH": str(beside),
        "PIP_TARGET": str(beside),
        "PIP_NO_INDEX": "1",
        "PIP_NO_DEPS": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # means: none
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "NO_COLOR": "1",
    }
