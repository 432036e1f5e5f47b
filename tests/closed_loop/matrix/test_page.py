"""The page docs/faults.md says what the matrix says; `make faults` fills in the results only."""

from pathlib import Path

ROOT = Path(__file__).parents[3]
CELLS = 4  # of a row: number, fault, what must happen, by when


def said(path):
    """The lines of the page without results, and without the table of mutations."""
    lines = (ROOT / path).read_text(encoding="utf-8").splitlines()
    rows = [line.split(" | ") for line in lines if not line.startswith(("| without ", "Made at "))]
    return [" | ".join(cells[:CELLS]).removesuffix(" |") for cells in rows]


def test_the_page_is_that_of_the_matrix():
    assert said("docs/faults.md") == said("tests/closed_loop/matrix/matrix.md")
