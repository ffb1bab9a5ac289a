"""What can be done with a node from the screen of nodes: by whom, with what result, and what is refused."""

import re
from html import unescape

from tests.unit.console.guarded_api import ADMIN, NODES, TENANT, Page, Stage, staged
from tests.unit.console.objects import Object, node

SHUTDOWN = "scheduler.robotics.io/graceful-shutdown"


def read_annotations(stage: Stage) -> Object:
    (stored,) = (obj for key, obj in stage.api.store.objects.items() if key.collection == NODES)
    return dict(stored["metadata"].get("annotations") or {})


def find_button(page: Page, action: str) -> str:
    """Returns the address of the page's button, empty without one."""
    button = re.search(rf'formaction="(/nodes/edge-1/{action}[^"]*)"', page.text)
    return unescape(button[1]) if button else ""


async def test_a_graceful_shutdown_is_begun_and_ended_by_buttons() -> None:
    async with staged() as stage:
        stage.api.put(NODES, node("edge-1", zone="hall-1"))
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        page = await browser.get("/nodes")
        assert not find_button(page, "end-shutdown")
        answer = await browser.post(find_button(page, "begin-shutdown"), {"csrf": page.field("csrf")})
        assert answer.status == 303
        assert read_annotations(stage)[SHUTDOWN] == "true"
        page = await browser.get(answer.headers["Location"])
        assert "edge-1 is shutting down gracefully" in page.text
        assert '<span class="phase bad">graceful shutdown</span>' in page.text
        answer = await browser.post(find_button(page, "end-shutdown"), {"csrf": page.field("csrf")})
        assert answer.status == 303
        assert SHUTDOWN not in read_annotations(stage)


async def test_who_may_not_patch_nodes_sees_no_button_and_is_refused() -> None:
    async with staged() as stage:
        stage.api.put(NODES, node("edge-1"))
        browser = stage.browser()
        await browser.sign_in(TENANT, home="team-a")
        page = await browser.get("/nodes")
        assert "shutdown" not in page.text
        refused = await browser.post("/nodes/edge-1/begin-shutdown?uid=u", {"csrf": page.field("csrf")})
        assert refused.status == 403
        assert SHUTDOWN not in read_annotations(stage)


async def test_without_csrf_token_uid_or_a_possible_name_nothing_is_written() -> None:
    async with staged() as stage:
        stage.api.put(NODES, node("edge-1"))
        browser = stage.browser()
        await browser.sign_in(ADMIN)
        csrf = (await browser.get("/nodes")).field("csrf")
        assert (await browser.post("/nodes/edge-1/begin-shutdown?uid=u", {})).status == 403
        assert (await browser.post("/nodes/edge-1/begin-shutdown", {"csrf": csrf})).status == 422
        assert (await browser.post("/nodes/..%2Fx/begin-shutdown?uid=u", {"csrf": csrf})).status in (400, 404)
        assert (await browser.post("/nodes/edge-1/begin-shutdown?uid=another", {"csrf": csrf})).status == 409
        assert SHUTDOWN not in read_annotations(stage)
