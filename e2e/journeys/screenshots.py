"""`scripts/screenshots`: the console's pictures, taken in a real browser from the demo's fleet; `--graphs`: those of the applications."""

import argparse
import base64
import re
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser, BrowserContext, Page

from journeys.demo import set_up
from journeys.demo_cluster import NAMESPACE, ROOT, DemoCluster
from journeys.graphs import draw_graphs
from journeys.stage import Stage
from robotapp_testbed import ControlPlane, TestbedError
from robotapp_testbed.browser.chromium import open_browser

FOLDER: Final = ROOT / "docs" / "pictures"
MOST_BYTES: Final = 150_000
_QUALITIES: Final = (90, 80, 70, 60, 45)
_WIDTH: Final = 1200
_SETTLED_MS: Final = 1000


def _leave(page: Page) -> None:
    """Leaves the page as it was opened."""
    del page


def _change_weights(page: Page) -> None:
    """Changes two weights, and shows them beside the text that follows."""
    page.locator("summary").filter(has_text=re.compile(r"^\s*filter\b")).first.click()
    for plugin, weight in (("NodeResourcesFit", "5"), ("NodeAffinity", "1")):
        page.get_by_label(f"Weight of {plugin}", exact=True).first.fill(weight)
    page.locator("#yaml .added").first.wait_for()


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture; a page of which the console has none leaves the picture that is there as it is."""

    name: str
    path: str
    height: int
    is_dark: bool = False
    prepare: Callable[[Page], None] = _leave
    """What is done on the page before the picture is taken."""


PICTURES: Final = (
    Picture("fleet", "/", 560),
    Picture("app", f"/apps/{NAMESPACE}/teleop", 900),
    Picture("scheduler", "/scheduler", 900, prepare=_change_weights),
    Picture("nodes", "/nodes?near=hall-1&far=hall-2", 900, is_dark=True),
)


def main() -> int:
    arguments = _make_parser().parse_args()
    stage = Stage()
    try:
        if arguments.graphs:
            for sentence in draw_graphs(stage):
                print(sentence)
            return 0
        arguments.into.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            browser = stack.enter_context(open_browser())
            cluster = stack.enter_context(ControlPlane())
            demo = set_up(stage, cluster, stack)
            _start_apps(demo)
            for picture in PICTURES:
                print(_take(browser, demo, picture, arguments.into))
    except TestbedError as failure:
        print(f"No pictures: {failure}", file=sys.stderr)
        return 1
    return 0


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/screenshots", description="Takes the pictures of the console.")
    parser.add_argument("--into", type=Path, default=FOLDER, help="folder of the pictures")
    graphs = "instead: the console's graph of each application of examples/reference, into its folder; needs no browser"
    parser.add_argument("--graphs", action="store_true", help=graphs)
    return parser


def _start_apps(demo: DemoCluster) -> None:
    """One app runs within its budgets, one holds a device, one waits for it, and one has no robot."""
    for name in ("teleop", "can-holder", "minimal"):
        demo.apply_file(f"examples/{name}.yaml")
    for name in ("teleop", "can-holder"):
        demo.kubectl("wait", "robotapp", name, "--for=condition=Ready", "--timeout=90s")
    demo.apply_file("examples/can-rival.yaml")
    demo.kubectl("wait", "robotapp", "can-rival", "--for=condition=Allocated=False", "--timeout=90s")


def _take(browser: Browser, demo: DemoCluster, picture: Picture, folder: Path) -> str:
    """Takes one picture and returns a sentence about it. Raises TestbedError when it cannot be made small enough."""
    with _open_context(browser, demo, picture) as context:
        page = context.new_page()
        answer = page.goto(picture.path)
        if answer is None or not answer.ok:
            return f"{picture.name}: the console has no such page, nothing is changed"
        picture.prepare(page)
        page.wait_for_timeout(_SETTLED_MS)  # the stream has sent what is new
        for quality in _QUALITIES:
            image = _shoot(page, quality)
            if len(image) <= MOST_BYTES:
                target = folder / f"console-{picture.name}.webp"
                target.write_bytes(image)
                return f"{target}: {len(image) / 1000:.0f} kB"
    raise TestbedError(f"the picture {picture.name} has more than {MOST_BYTES / 1000:.0f} kB: make it smaller")


def _open_context(browser: Browser, demo: DemoCluster, picture: Picture) -> BrowserContext:
    context = browser.new_context(
        viewport={"width": _WIDTH, "height": picture.height},
        color_scheme="dark" if picture.is_dark else "light",
        base_url=demo.console.origin,
    )
    name, _, value = demo.console.open_session().partition("=")
    context.add_cookies([{"name": name, "value": value, "url": demo.console.origin}])
    return context


def _shoot(page: Page, quality: int) -> bytes:
    """Returns what is visible of the page, as WebP."""
    session = page.context.new_cdp_session(page)
    shot = session.send("Page.captureScreenshot", {"format": "webp", "quality": quality})
    return base64.b64decode(shot["data"])


if __name__ == "__main__":
    sys.exit(main())
