"""The tutorials of the reference applications, line by line, up to the picture in the console. One cluster serves them all."""

import re
from pathlib import Path

import pytest
from e2e.tests.live.testbed.reader import CONSOLE, EXAMPLES, Reader

from robotapp_testbed import wait_until

pytestmark = pytest.mark.live

PAGES = sorted((EXAMPLES.parent / "docs" / "tutorials").glob("*.md"))
SEEN_S = 60.0


def read_app(page: str) -> str:
    (app,) = re.findall(r"^!\[(\S+) in the console", page, re.MULTILINE)
    return str(app)


def show_graph(reader: Reader, page: Path) -> None:
    """Opens the console as the page does, and looks for the graph of its app."""
    text = page.read_text()
    app = read_app(text)
    assert f"```sh\n{CONSOLE}\n```" in text
    with reader.console(CONSOLE) as address:
        browser = reader.open_browser(address)
        has_graph = wait_until(
            lambda: (
                f"Graph of {app}" in browser(f"/apps/default/{app}") and "edge good" in browser(f"/apps/default/{app}")
            ),
            timeout_s=SEEN_S,
        )
        assert has_graph, browser(f"/apps/default/{app}")


def test_each_tutorial_runs_line_by_line_as_its_page_has_it(reader: Reader) -> None:
    assert len(PAGES) == 5
    for page in PAGES:
        before, _, after = page.read_text().partition(f"```sh\n{CONSOLE}")
        reader.follows(before)
        show_graph(reader, page)
        reader.follows(after.partition("```\n")[2])
