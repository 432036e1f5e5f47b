"""Links of the pages hold on the site, too."""

import importlib.util
import re

import pytest

from tests.docs.tutorial import ROOT

spec = importlib.util.spec_from_file_location("build_site", ROOT / "docs" / "build_site.py")
build_site = importlib.util.module_from_spec(spec)
spec.loader.exec_module(build_site)


@pytest.mark.parametrize(
    ("page", "link", "on_the_site"),
    [
        ("docs/solver.md", "[c](../companion/control/nmpc/config.py)", "c"),
        (
            "docs/perception.md",
            "[a](../CONTRIBUTING.md#a-detector)",
            "[a](CONTRIBUTING.md#a-detector)",
        ),
        ("docs/tutorials/operator.md", "[f](../flights.md#x)", "[f](../flights.md#x)"),
        ("docs/flights.md", "![r](report.jpg)", "![r](report.jpg)"),
        ("docs/flights.md", "[m](https://mcap.dev)", "[m](https://mcap.dev)"),
        ("CONTRIBUTING.md", "[a](docs/architecture.md)", "[a](architecture.md)"),
        ("CONTRIBUTING.md", "[l](LICENSE)", "l"),
        ("docs/flights.md", "[here](#report)", "[here](#report)"),
    ],
)
def test_a_link_holds_or_becomes_words(page, link, on_the_site):
    assert build_site.mended(link, build_site.Path(page), ROOT) == on_the_site


def test_every_page_is_copied_and_every_link_to_a_page_has_its_page(tmp_path):
    build_site.copy_pages(ROOT, tmp_path / "site")
    pages = [*(tmp_path / "site").rglob("*.md")]
    assert len(pages) >= len([*(ROOT / "docs").rglob("*.md")]) + 2
    missing = [
        f"{page.name}: {target}"
        for page in pages
        for target in re.findall(r"\]\(([^)#:\s]+\.md)(?:#[^)]*)?\)", page.read_text())
        if not (page.parent / target).exists()
    ]
    assert missing == []


def test_the_navigation_names_pages_that_are_there(tmp_path):
    build_site.copy_pages(ROOT, tmp_path / "site")
    nav = (ROOT / "mkdocs.yml").read_text().partition("nav:")[2]
    named = re.findall(r": (\S+\.md)", nav)
    assert {"tutorials/researcher.md", "tutorials/engineer.md", "api.md"} <= set(named)
    assert [n for n in named if not (tmp_path / "site" / n).exists()] == []
