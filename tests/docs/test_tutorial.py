"""A page is followed as it says, and a failure names the page's line."""

import pytest

from tests.docs.tutorial import follow

PAGE = """# A page

```sh
mkdir made && cd made
export GREETING=hello
```

```text
no command
```

```sh title="said/greet.sh"
echo "$GREETING, $1"
```

<!-- not run: needs a drone -->

```sh
false
```

<!-- exits: 3 -->

```sh
exit 3
```

<!-- runs until: it's up -->

```sh
trap 'touch ended; exit 130' INT
echo "it's up"
while true; do sleep 0.1; done
```

```python
from pathlib import Path
Path("from-python").write_text("yes")
```

```sh
bash said/greet.sh reader
```
"""


def test_a_page_is_followed_from_top_to_bottom(tmp_path):
    (tmp_path / "page.md").write_text(PAGE)
    folder = tmp_path / "empty"
    folder.mkdir()
    assert follow(tmp_path / "page.md", folder).splitlines() == ["it's up", "hello, reader"]
    assert (folder / "made/from-python").read_text() == "yes"
    assert (folder / "made/ended").exists()


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("```sh\ntrue\nfalse  # so it ends\ntrue\n```\n", "page.md:5: exit status 1: false"),
        ("```sh\nno-such-program\n```\n", "page.md: line 4: no-such-program: command not found"),
        ("<!-- exits: 2 -->\n```sh\ntrue\n```\n", "exit status 0, not 2"),
        ("<!-- runs until: up -->\n```sh\necho down\n```\n", "ended before it said 'up':\ndown"),
        ("```python\nraise ValueError\n```\n", "page.md:3: exit status 1"),
        ("```sh\n", "a block does not end"),
    ],
)
def test_what_fails_is_named(tmp_path, block, said):
    (tmp_path / "page.md").write_text("# A page\n\n" + block)
    with pytest.raises(AssertionError, match=r"(?s).*") as found:
        follow(tmp_path / "page.md", tmp_path)
    assert said in str(found.value)
