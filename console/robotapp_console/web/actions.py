"""Changes that forms ask for: refused without the right, made with the caller's token, and answered with what came of it."""

import logging
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl, urlencode, urlsplit

from aiohttp import web

from robotapp_client import ApiClient, ApiError, ClientError, Forbidden, Unauthorized
from robotapp_client.transport.errors import means_another
from robotapp_console.cluster.rights import Right
from robotapp_console.cluster.writes import NothingToChangeError
from robotapp_console.views.texts import clean
from robotapp_console.web.console import CALLER, CONSOLE, Console
from robotapp_console.web.sessions import Caller
from robotapp_console.web.signing import answer_expired

log = logging.getLogger(__name__)
NOTICE_S: Final = 60
"""So long the page says what was done: an address that is kept or shared does not say it for ever."""


class RefusedInputError(Exception):
    """A form holds something that cannot be used; the text says what is allowed."""


@dataclass(frozen=True, slots=True)
class Action:
    """One change. `target` is the page to go to afterwards, also the way back from a refusal."""

    right: Right
    """Without it the button is not shown and the form is refused."""
    work: Callable[[ApiClient], Awaitable[str]]
    """Makes the change and returns a sentence about it. Raises ClientError, NothingToChangeError or RefusedInputError."""
    target: str


async def perform_action(request: web.Request, action: Action) -> web.StreamResponse:
    """Makes the change as the caller; afterwards the browser goes to the target, which says what was done."""
    console, caller = request.app[CONSOLE], request[CALLER]
    informers = await console.informers.get(caller.key, caller.endpoint)
    try:
        if not await informers.rights.is_granted(action.right, fresh=True):
            return _answer_refusal(request, action, 403, "Not allowed", f"You may not {action.right.words}.")
        sentence = await informers.show_write(lambda: action.work(informers.client))
    except RefusedInputError as error:
        return _answer_refusal(request, action, 422, "Not done", str(error))
    except NothingToChangeError as error:
        return _answer_refusal(request, action, 404, "Not done", str(error))
    except Unauthorized:
        return answer_expired(request)
    except ClientError as error:
        return _answer_failure(request, action, error)
    log.info("%s: %r", caller.user or "a user without a name", sentence)
    return web.Response(status=303, headers={"Location": add_notice(console, caller, action.target, sentence)})


def _answer_failure(request: web.Request, action: Action, error: ClientError) -> web.StreamResponse:
    """Answers with what the API server said, or that it said nothing."""
    reason = clean(str(error))
    if isinstance(error, Forbidden):
        return _answer_refusal(request, action, 403, "Not allowed", reason)
    if isinstance(error, ApiError) and means_another(error):
        text = "The object was deleted and made anew since the page was loaded. Load the page again."
        return _answer_refusal(request, action, 409, "Not done", text)
    if isinstance(error, ApiError) and error.status < 500:
        return _answer_refusal(request, action, error.status, "Not done", f"The API server refused: {reason}")
    doubt = " Whether it was done is not known: load the page again." if error.maybe_applied else ""
    return _answer_refusal(request, action, 503, "Not done", f"The API server cannot be reached: {reason}.{doubt}")


def _answer_refusal(request: web.Request, action: Action, status: int, title: str, text: str) -> web.StreamResponse:
    caller = request[CALLER]
    log.warning("%s: %s %r: %d %r", caller.user or "a user without a name", request.method, request.path, status, text)
    return request.app[CONSOLE].answer_message(request, status, title, text, links={"Back": action.target})


def add_notice(console: Console, caller: Caller, target: str, sentence: str) -> str:
    """Returns the target's address with the sentence, signed: nobody else can make a page say that something was done."""
    until = str(int(time.time()) + NOTICE_S)
    sentence = clean(sentence)
    mark = console.seal.sign(_notice_content(caller, urlsplit(target).path, sentence, until))
    fields = {"notice": sentence, "until": until, "mark": mark}
    return f"{target}{'&' if '?' in target else '?'}{urlencode(fields)}"


def read_notice(console: Console, caller: Caller, request: web.Request) -> str:
    """Returns the sentence that `add_notice` put into the address; empty when another wrote it, or it is older than a minute."""
    sentence, until, mark = (request.query.get(name, "") for name in ("notice", "until", "mark"))
    if not (sentence and until.isascii() and until.isdigit() and len(until) < 12 and int(until) > time.time()):
        return ""
    content = _notice_content(caller, request.path, sentence, until)
    return sentence if console.seal.is_signed(content, mark) else ""


def drop_notice(query: str) -> str:
    """Returns the query of an address without a notice."""
    fields = parse_qsl(query, keep_blank_values=True)
    return urlencode([(name, value) for name, value in fields if name not in ("notice", "until", "mark")])


def _notice_content(caller: Caller, path: str, sentence: str, until: str) -> str:
    return f"notice\n{caller.session}\n{path}\n{until}\n{sentence}"
