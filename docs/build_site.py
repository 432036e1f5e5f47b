"""Builds the site: `make docs`. Copies the pages, mends links that leave docs/, runs Zensical.

On the hosting site a page links to CONTRIBUTING.md or to a file of code beside docs/; the site has
the former as a page, and names the latter without a link.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("CONTRIBUTING.md", "CHANGELOG.md")  # beside docs/, pages of the site
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def mended(text: str, page: Path, root: Path) -> str:
    """Return a page with links that hold inside the site; page: its path below docs/ or root."""

    def mend(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        path, hash_, place = target.partition("#")
        if not path or "://" in target or picture:
            return link[0]
        wanted = (root / page.parent / path).resolve()
        if wanted.is_relative_to(root / "docs"):
            inside = wanted.relative_to(root / "docs")
        elif wanted.parent == root and wanted.name in PAGES:
            inside = Path(wanted.name)
        else:
            return words
        here = page.relative_to("docs").parent if page.parts[0] == "docs" else Path()
        up = Path(*[".."] * len(here.parts)) / inside
        return f"[{words}]({up.as_posix()}{hash_}{place})"

    return _LINK.sub(mend, text)


def copy_pages(root: Path, out: Path) -> None:
    """Write all pages and pictures into a folder."""
    shutil.rmtree(out, ignore_errors=True)
    shutil.copytree(root / "docs", out, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    for path in [*(root / "docs").rglob("*.md"), *(root / name for name in PAGES)]:
        page = path.relative_to(root)
        place = out / (page.relative_to("docs") if page.parts[0] == "docs" else page)
        place.write_text(mended(path.read_text("utf-8"), page, root), "utf-8")


if __name__ == "__main__":
    copy_pages(ROOT, ROOT / "build" / "docs")
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean"]
    sys.exit(subprocess.run(command, cwd=ROOT, check=False).returncode)
