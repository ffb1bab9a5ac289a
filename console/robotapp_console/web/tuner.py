"""The screen of the scheduler: shows its configuration as a form, tries it, applies it as the user, and takes it back."""

import asyncio
import logging
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from aiohttp import web

from robotapp_client import ClientError, Unauthorized
from robotapp_client.transport.errors import Forbidden
from robotapp_console.cluster.config_store import ConfigStore, NotRecordedError, StaleError, State, StoredConfig
from robotapp_console.cluster.informer_set import InformerSet
from robotapp_console.cluster.scheduler_port import SchedulerPortError
from robotapp_console.views.replay import ReplayResult, build_replay
from robotapp_console.views.texts import clean
from robotapp_console.web.console import CALLER, CONSOLE, Console
from robotapp_console.web.sessions import Caller
from robotapp_console.web.signing import answer_expired

if TYPE_CHECKING:
    from robotapp_console.tuning.draft import Draft

log = logging.getLogger(__name__)
PATH: Final = "/scheduler"
MOST_REPLAYED: Final = 500
USUAL_REPLAYED: Final = 200
_COUNT: Final = re.compile("[0-9]{1,3}")
CHANGED: Final = (
    "Somebody else changed the configuration since you loaded it. Nothing was written. The marked lines below are the "
    "difference between yours and theirs now."
)
_ACTIONS: Final = frozenset({"preview", "replay", "apply", "undo", "text", "restore"})
_SHORT_FORM: Final = "The form arrived incomplete. Load the page again."


@dataclass(frozen=True, slots=True)
class Tuner:
    """One request for this screen: who makes it, and the store that it may use."""

    console: Console
    caller: Caller
    informers: InformerSet
    store: ConfigStore

    @classmethod
    async def open(cls, request: web.Request) -> "Tuner":
        console, caller = request.app[CONSOLE], request[CALLER]
        informers = await console.informers.get(caller.key, caller.endpoint)
        return cls(console, caller, informers, ConfigStore(informers.client, console.config_place))

    async def draft(self, config: StoredConfig, base: str, fields: Mapping[str, str] | None) -> "Draft":
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
    tuner = await Tuner.open(request)
    try:
        config = await (tuner.store.wait_for_reload() if "applied" in request.query else tuner.store.read())
    except Unauthorized:
        return answer_expired(request)
    return await _answer_page(request, tuner, config, await tuner.draft(config, config.text or "", None))


async def change_scheduler(request: web.Request) -> web.StreamResponse:
    """Takes the form: `action` is the button, none of which was pressed when a field changed."""
    tuner = await Tuner.open(request)
    fields = {name: str(value) for name, value in (await request.post()).items()}
    try:
        config = await tuner.store.read()
        if config.text is None:
            return await _answer_page(request, tuner, config, await tuner.draft(config, "", None))
        action = fields.get("action", "preview")
        if action == "undo":
            return await _undo(request, tuner, config, fields)
        draft, message = await _read_draft(tuner, config, fields, action)
        if "HX-Request" in request.headers:
            return await _answer_outcome(request, tuner, config, draft)
        if action == "apply":
            return await _apply(request, tuner, config, draft, fields)
        if action == "replay":
            return await _replay(request, tuner, config, draft, fields)
    except Unauthorized:
        return answer_expired(request)
    return await _answer_page(request, tuner, config, draft, message=message)


async def _read_draft(
    tuner: Tuner, stored: StoredConfig, fields: Mapping[str, str], action: str
) -> "tuple[Draft, Message | None]":
    if action == "text":
        return await tuner.draft(stored, fields.get("text", "").replace("\r\n", "\n"), None), None
    if action == "restore":
        version = next((v for v in stored.history if str(v.number) == fields.get("number", "")), None)
        if version is None:
            return await tuner.draft(stored, stored.text or "", None), Message(
                "That version is not kept any more.", is_error=True
            )
        return await tuner.draft(stored, version.text, None), Message(
            f"This is version {version.number}. Nothing is written until you apply it."
        )
    if action not in _ACTIONS:
        raise web.HTTPBadRequest(text=f"This page has no button for {action[:40]!r}: {', '.join(sorted(_ACTIONS))}.")
    if "complete" not in fields:
        raise web.HTTPBadRequest(text=_SHORT_FORM)
    return await tuner.draft(stored, fields.get("base", "").replace("\r\n", "\n"), fields), None


def _make_draft(text: str, base: str, fields: Mapping[str, str] | None, running: str) -> "Draft":
    """Returns the draft. The scheduler's loader comes with the first one: its 20 MB are needed by no other screen."""
    from robotapp_console.tuning.draft import Stored, make_draft, read_stored

    return make_draft(read_stored(text) if text else Stored(""), base, fields, running=running)


async def _apply(
    request: web.Request, tuner: Tuner, stored: StoredConfig, draft: "Draft", fields: Mapping[str, str]
) -> web.StreamResponse:
    if not draft.may_be_applied:
        text = "There are mistakes: nothing was written." if draft.problems else "Nothing differs from what is stored."
        return await _answer_page(request, tuner, stored, draft, message=Message(text, is_error=True), status=422)
    if fields.get("version") != stored.version:
        return await _answer_page(request, tuner, stored, draft, message=Message(CHANGED, is_error=True), status=409)
    return await _write(request, tuner, stored, draft, draft.text)


async def _undo(
    request: web.Request, tuner: Tuner, stored: StoredConfig, fields: Mapping[str, str]
) -> web.StreamResponse:
    previous = stored.previous
    draft = await tuner.draft(stored, stored.text or "", None)
    if previous is None:
        message = Message("There is no earlier version to go back to.", is_error=True)
        return await _answer_page(request, tuner, stored, draft, message=message, status=409)
    if fields.get("version") != stored.version:
        return await _answer_page(request, tuner, stored, draft, message=Message(CHANGED, is_error=True), status=409)
    return await _write(request, tuner, stored, draft, previous.text)


async def _write(
    request: web.Request, tuner: Tuner, stored: StoredConfig, draft: "Draft", text: str
) -> web.StreamResponse:
    try:
        await tuner.store.apply(stored, text, author=await tuner.find_author())
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
        log.info("%s changed the scheduler's configuration", tuner.caller.user or "a user without a name")
        return web.Response(status=303, headers={"Location": f"{PATH}?applied=1"})
    return await _answer_page(request, tuner, await tuner.store.read(), draft, message=message, status=status)


async def _replay(
    request: web.Request, tuner: Tuner, stored: StoredConfig, draft: "Draft", fields: Mapping[str, str]
) -> web.StreamResponse:
    count = fields.get("replay", "")
    if not (_COUNT.fullmatch(count) and 1 <= int(count) <= MOST_REPLAYED):
        message = Message(f"From 1 to {MOST_REPLAYED} placements can be judged.", is_error=True)
        return await _answer_page(request, tuner, stored, draft, message=message, status=422)
    if draft.problems or draft.document is None:
        message = Message("There are mistakes: nothing can be judged with this configuration.", is_error=True)
        return await _answer_page(request, tuner, stored, draft, message=message, status=422)
    try:
        answer = await tuner.console.scheduler.replay(
            tuner.caller.endpoint, draft.document, int(count), namespace=tuner.caller.home
        )
    except SchedulerPortError as error:
        return await _answer_page(request, tuner, stored, draft, message=Message(str(error), is_error=True), status=502)
    return await _answer_page(request, tuner, stored, draft, result=build_replay(answer, int(count)))


async def _answer_page(
    request: web.Request,
    tuner: Tuner,
    stored: StoredConfig,
    draft: "Draft",
    *,
    message: Message | None = None,
    result: ReplayResult | None = None,
    status: int = 200,
) -> web.Response:
    """Returns the whole page, for browsers with and without JavaScript."""
    context = _build_context(tuner, stored, draft) | {"title": "Scheduler", "screen": PATH, "message": message}
    context |= {
        "result": result,
        "replayed": result.asked if result else USUAL_REPLAYED,
        "most_replayed": MOST_REPLAYED,
    }
    async with tuner.informers.turn:
        page = tuner.console.render(request, "scheduler.html", context, now_s=time.time())
    return web.Response(status=status, text=page, content_type="text/html")


async def _answer_outcome(request: web.Request, tuner: Tuner, stored: StoredConfig, draft: "Draft") -> web.Response:
    """Returns what follows from the fields: the text with its changed lines, and every mistake."""
    context = _build_context(tuner, stored, draft)
    async with tuner.informers.turn:
        page = tuner.console.render(request, "scheduler_outcome.html", context, now_s=time.time())
    return web.Response(text=page, content_type="text/html")


def _build_context(tuner: Tuner, stored: StoredConfig, draft: "Draft") -> dict[str, Any]:
    place = tuner.console.config_place
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
        "scheduler": tuner.console.scheduler,
    }
