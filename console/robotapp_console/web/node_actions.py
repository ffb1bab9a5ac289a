"""What can be done with a node from the screen of nodes: begin and end its graceful shutdown."""

from functools import partial
from typing import Final

from aiohttp import web

from robotapp_api.model.names import Annotation
from robotapp_api.values.arguments import is_name
from robotapp_client import ApiClient
from robotapp_client.api.resources import NODES
from robotapp_console.cluster.rights import Right
from robotapp_console.cluster.writes import annotate
from robotapp_console.web.actions import Action, RefusedInputError, perform_action

SHUT_DOWN: Final = Right("patch", NODES)
BEGIN: Final = "begin-shutdown"


async def act_on_node(request: web.Request) -> web.StreamResponse:
    """Takes the press of a button of the screen of nodes."""
    name = request.match_info["name"]
    if not is_name(name):
        raise web.HTTPBadRequest(text="No node can have that name: small letters, digits, dots and dashes.")
    uid = request.query.get("uid", "")
    begin = request.match_info["action"] == BEGIN
    work = partial(_set_shutdown, name, uid=uid, begin=begin)
    return await perform_action(request, Action(SHUT_DOWN, work, "/nodes"))


async def _set_shutdown(name: str, client: ApiClient, *, uid: str, begin: bool) -> str:
    """Writes or removes the annotation. Raises RefusedInputError without a uid: another node of this name could be meant."""
    if not uid:
        raise RefusedInputError("The form does not say which node it is about (uid): load the page again.")
    value = "true" if begin else None
    await annotate(client, NODES, name, {Annotation.GRACEFUL_SHUTDOWN: value}, uid=uid)
    if begin:
        return f"{name} is shutting down gracefully: it gets no new pods of RobotApps, and those on it go on."
    return f"The graceful shutdown of {name} has ended: it gets pods of RobotApps again."
