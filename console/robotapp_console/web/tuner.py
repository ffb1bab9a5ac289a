"""The screen of the scheduler: shows its configuration as a form, tries it, applies it as the user, and takes it back."""

import asyncio
import logging
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from aiohttp import web

from robotapp_client import ClientError, Unauthorized
from robotapp_client.transport.errors import Forbidden
from robotapp_console.cluster.config_store import ConfigStore, NotRecordedError, StaleError, State, StoredConfig
from robotapp_console.cluster.informer_set import InformerSet
from robotapp_console.cluster.scheduler_port import SchedulerPortError
from robotapp_console.tuning.draft import Draft, Stored, make_draft, read_stored
from robotapp_console.views.replay import ReplayResult, build_replay
from robotapp_console.views.texts import clean
from robotapp_console.web.console import CALLER, CONSOLE, Console
from robotapp_console.web.sessions import Caller
from robotapp_console.web.signing import answer_expired

log = logging.getLogger(__name__)
PATH: Final = "/scheduler"
MOST_REPLAYED: Final = 500
USUAL_REPLAYED: Final = 200
_COUNT: Final = re.compile("[0-9]{1,3}")
CHANGED: Final = (
    "Somebody else changed the configuration since you loaded it. Nothing was written. The marked lines below are the "
    "difference between yours and theirs now."
)
_SHORT_FORM: Final = "The form arrived incomplete. Load the page again."


@dataclass(frozen=True, slots=True)
class Desk:
    """One request for this screen: who makes it, and the store that it may use."""

    console: Console
    caller: Caller
    informers: InformerSet
    store: ConfigStore

    @classmethod
    async def open(cls, request: web.Request) -> "Desk":
        console, caller = request.app[CONSOLE], request[CALLER]
        informers = await console.informers.get(caller.key, caller.endpoint)
        return cls(console, caller, informers, ConfigStore(informers.client, console.config_place))

    async def draft(self, config: StoredConfig, base: str, fields: Mapping[str, str] | None) -> Draft:
        """Returns the draft that the fields of the text `base` mean."""
        async with self.console.drafting:
            return await asyncio.to_thread(_make_draft, config.text or "", base, fields, config.running or "")

    async def find_author(self) -> str:
        """Returns how the API server names the user."""
        return self.caller.user or await self.informers.fetch_user()


@dataclass(frozen=True, slots=True)
class Message:
    """A sentence about the button that was pressed. `is_error` decides its colour."""

    text: str
    is_error: bool = False


async def show_scheduler(request: web.Request) -> web.StreamResponse:
    """The page. Just after a change it waits for what the scheduler makes of it."""
    desk = await Desk.open(request)
    try:
        config = await (desk.store.wait_for_reload() if "applied" in request.query else desk.store.read())
    except Unauthorized:
        return answer_expired(request)
    return await _answer_page(request, desk, config, await desk.draft(config, config.text or "", None))


async def change_scheduler(request: web.Request) -> web.StreamResponse:
    """Takes the form: `action` is the button, none of which was pressed when a field changed."""
    desk = await Desk.open(request)
    fields = {name: str(value) for name, value in (await request.post()).items()}
    try:
        config = await desk.store.read()
        if config.text is None:
            return await _answer_page(request, desk, config, Draft("", ""))
        action = fields.get("action", "preview")
        if action == "undo":
            return await _undo(request, desk, config, fields)
        draft, message = await _read_draft(desk, config, fields, action)
        if "HX-Request" in request.headers:
            return await _answer_outcome(request, desk, config, draft)
        if action == "apply":
            return await _apply(request, desk, config, draft, fields)
        if action == "replay":
            return await _replay(request, desk, config, draft, fields)
    except Unauthorized:
        return answer_expired(request)
    return await _answer_page(request, desk, config, draft, message=message)


async def _read_draft(
    desk: Desk, stored: StoredConfig, fields: Mapping[str, str], action: str
) -> tuple[Draft, Message | None]:
    if action == "text":
        return await desk.draft(stored, fields.get("text", "").replace("\r\n", "\n"), None), None
    if action == "restore":
        version = next((v for v in stored.history if str(v.number) == fields.get("number", "")), None)
        if version is None:
            return await desk.draft(stored, stored.text or "", None), Message(
                "That version is not kept any more.", is_error=True
            )
        return await desk.draft(stored, version.text, None), Message(
            f"This is version {version.number}. Nothing is written until you apply it."
        )
    if "complete" not in fields:
        raise web.HTTPBadRequest(text=_SHORT_FORM)
    return await desk.draft(stored, fields.get("base", "").replace("\r\n", "\n"), fields), None


def _make_draft(text: str, base: str, fields: Mapping[str, str] | None, running: str) -> Draft:
    return make_draft(read_stored(text) if text else Stored(""), base, fields, running=running)


async def _apply(
    request: web.Request, desk: Desk, stored: StoredConfig, draft: Draft, fields: Mapping[str, str]
) -> web.StreamResponse:
    if not draft.may_be_applied:
        text = "There are mistakes: nothing was written." if draft.problems else "Nothing differs from what is stored."
        return await _answer_page(request, desk, stored, draft, message=Message(text, is_error=True), status=422)
    if fields.get("version") != stored.version:
        return await _answer_page(request, desk, stored, draft, message=Message(CHANGED, is_error=True), status=409)
    return await _write(request, desk, stored, draft, draft.text)


async def _undo(
    request: web.Request, desk: Desk, stored: StoredConfig, fields: Mapping[str, str]
) -> web.StreamResponse:
    previous = stored.previous
    draft = await desk.draft(stored, stored.text or "", None)
    if previous is None:
        message = Message("There is no earlier version to go back to.", is_error=True)
        return await _answer_page(request, desk, stored, draft, message=message, status=409)
    if fields.get("version") != stored.version:
        return await _answer_page(request, desk, stored, draft, message=Message(CHANGED, is_error=True), status=409)
    return await _write(request, desk, stored, draft, previous.text)


async def _write(request: web.Request, desk: Desk, stored: StoredConfig, draft: Draft, text: str) -> web.StreamResponse:
    try:
        await desk.store.apply(stored, text, author=await desk.find_author())
    except StaleError:
        message, status = Message(CHANGED, is_error=True), 409
    except NotRecordedError as error:
        text = f"Applied, but not recorded among the versions: {error}. Undo goes back to the newest version there is."
        message, status = Message(text, is_error=True), 502
    except Unauthorized:
        raise
    except Forbidden as error:
        message, status = Message(f"You may not change it. {clean(error.message)}", is_error=True), 403
    except ClientError as error:
        maybe = " It may have been written all the same: load the page again." if error.maybe_applied else ""
        message, status = Message(f"The API server did not take it: {clean(str(error))}.{maybe}", is_error=True), 502
    else:
        log.info("%s changed the scheduler's configuration", desk.caller.user or "a user without a name")
        return web.Response(status=303, headers={"Location": f"{PATH}?applied=1"})
    return await _answer_page(request, desk, await desk.store.read(), draft, message=message, status=status)


async def _replay(
    request: web.Request, desk: Desk, stored: StoredConfig, draft: Draft, fields: Mapping[str, str]
) -> web.StreamResponse:
    count = fields.get("replay", "")
    if not (_COUNT.fullmatch(count) and 1 <= int(count) <= MOST_REPLAYED):
        message = Message(f"From 1 to {MOST_REPLAYED} placements can be judged.", is_error=True)
        return await _answer_page(request, desk, stored, draft, message=message, status=422)
    if draft.problems or draft.document is None:
        message = Message("There are mistakes: nothing can be judged with this configuration.", is_error=True)
        return await _answer_page(request, desk, stored, draft, message=message, status=422)
    try:
        answer = await desk.console.scheduler.replay(
            desk.caller.endpoint, draft.document, int(count), namespace=desk.caller.home
        )
    except SchedulerPortError as error:
        return await _answer_page(request, desk, stored, draft, message=Message(str(error), is_error=True), status=502)
    return await _answer_page(request, desk, stored, draft, result=build_replay(answer, int(count)))


async def _answer_page(
    request: web.Request,
    desk: Desk,
    stored: StoredConfig,
    draft: Draft,
    *,
    message: Message | None = None,
    result: ReplayResult | None = None,
    status: int = 200,
) -> web.Response:
    """Returns the whole page, for browsers with and without JavaScript."""
    context = _build_context(desk, stored, draft) | {"title": "Scheduler", "screen": PATH, "message": message}
    context |= {
        "result": result,
        "replayed": result.asked if result else USUAL_REPLAYED,
        "most_replayed": MOST_REPLAYED,
    }
    async with desk.informers.turn:
        page = desk.console.render(request, "scheduler.html", context, now_s=time.time())
    return web.Response(status=status, text=page, content_type="text/html")


async def _answer_outcome(request: web.Request, desk: Desk, stored: StoredConfig, draft: Draft) -> web.Response:
    """Returns what follows from the fields: the text with its changed lines, and every mistake."""
    context = _build_context(desk, stored, draft)
    async with desk.informers.turn:
        page = desk.console.render(request, "scheduler_outcome.html", context, now_s=time.time())
    return web.Response(text=page, content_type="text/html")


def _build_context(desk: Desk, stored: StoredConfig, draft: Draft) -> dict[str, Any]:
    place = desk.console.config_place
    return {
        "stored": replace(stored, history=()),
        "states": State,
        "versions": tuple(replace(version, by=clean(version.by, 253)) for version in reversed(stored.history)),
        "current": next((v.number for v in reversed(stored.history) if v.text == stored.text), None),
        "previous": stored.previous,
        "place": place,
        "draft": draft,
        "may_write": stored.text is not None and not stored.denied,
        "has_comments": any(line.lstrip().startswith("#") for line in (stored.text or "").splitlines()),
        "scheduler": desk.console.scheduler,
    }
