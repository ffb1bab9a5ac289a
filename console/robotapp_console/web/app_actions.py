"""The buttons of an app's page: suspend, resume, restart a component, approve an update, delete."""

import time
from collections.abc import Awaitable, Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from typing import Final

from aiohttp import web

from robotapp_api.model.names import Annotation
from robotapp_api.values.arguments import is_name
from robotapp_api.values.naming import DNS_LABEL
from robotapp_client import ApiClient, ClientError, NotFound
from robotapp_client.api.resources import DEPLOYMENTS, NODES, ROBOTAPPS
from robotapp_console.cluster import writes
from robotapp_console.cluster.informer_set import InformerSet
from robotapp_console.cluster.rights import Right
from robotapp_console.views.problems import path_of_app
from robotapp_console.views.texts import clean
from robotapp_console.web.actions import Action, RefusedInputError, perform_action
from robotapp_console.web.console import CALLER, CONSOLE

_RIGHTS: Final[Mapping[str, Callable[[str, str], Right]]] = {
    "suspend": lambda namespace, name: Right("patch", ROBOTAPPS, namespace, name),
    "resume": lambda namespace, name: Right("patch", ROBOTAPPS, namespace, name),
    "approve": lambda namespace, name: Right("patch", ROBOTAPPS, namespace, name),
    "restart": lambda namespace, _: Right("patch", DEPLOYMENTS, namespace),
    "delete": lambda namespace, name: Right("delete", ROBOTAPPS, namespace, name),
}
_MOST_VERSION: Final = 64


async def find_allowed(informers: InformerSet, namespace: str, name: str) -> frozenset[str]:
    """Returns the actions for which the caller has the right."""
    right_by_action = {action: make_right(namespace, name) for action, make_right in _RIGHTS.items()}
    granted_rights = await informers.rights.select_granted(right_by_action.values())
    return frozenset(action for action, right in right_by_action.items() if right in granted_rights)


def read_app(request: web.Request) -> tuple[str, str]:
    """Returns namespace and name of the address. Raises HTTPBadRequest for what no object can be called: it would be part of a path."""
    namespace, name = request.match_info["namespace"], request.match_info["name"]
    if not DNS_LABEL.fullmatch(namespace) or not is_name(name):
        raise web.HTTPBadRequest(text="No app can have that name: small letters, digits and dashes.")
    return namespace, name


async def act_on_app(request: web.Request) -> web.StreamResponse:
    """Takes the press of a button, whose fields stand in the address, or the form of the page that confirms the deletion."""
    namespace, name = read_app(request)
    action = request.match_info["action"]
    form = await request.post()
    fields = dict(request.query) | {key: value for key, value in form.items() if isinstance(value, str)}
    work = partial(_WORK[action], namespace, name, fields)
    robot = fields.get("robot", "")
    target = "/" if action == "delete" else path_of_app(namespace, name, robot)
    return await perform_action(request, Action(_RIGHTS[action](namespace, name), work, target))


Fields = Mapping[str, str]


async def _suspend(namespace: str, name: str, fields: Fields, client: ApiClient) -> str:
    await writes.set_suspend(client, namespace, name, uid=_read_uid(fields), suspend=True)
    return f"{namespace}/{name} is suspended: its pods stop, its domain stays, its devices become free."


async def _resume(namespace: str, name: str, fields: Fields, client: ApiClient) -> str:
    await writes.set_suspend(client, namespace, name, uid=_read_uid(fields), suspend=False)
    return f"{namespace}/{name} is resumed: its pods start."


async def _approve(namespace: str, name: str, fields: Fields, client: ApiClient) -> str:
    version = fields.get("version", "")
    if not version or len(version) > _MOST_VERSION or not (version.isascii() and version.isprintable()):
        raise RefusedInputError("The operator's version is missing: load the page again.")
    await writes.approve_update(client, namespace, name, uid=_read_uid(fields), version=version)
    return f"Templates of operator {version} are approved for {namespace}/{name}."


async def _restart(namespace: str, name: str, fields: Fields, client: ApiClient) -> str:
    component, robot = fields.get("component", ""), fields.get("robot_of_component", "")
    if not component:
        raise RefusedInputError("No component is named: load the page again.")
    await writes.restart_component(
        client,
        namespace,
        name,
        uid=_read_uid(fields),
        robot=robot,
        component=component,
        at=datetime.fromtimestamp(time.time(), UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    )
    return f"{component}{f' on {robot}' if robot else ''} restarts: its pods are replaced."


async def _delete(namespace: str, name: str, fields: Fields, client: ApiClient) -> str:
    if fields.get("typed", "").strip() != name:
        raise RefusedInputError(f"Nothing was deleted: the name that was typed is not {name}.")
    await writes.delete_app(client, namespace, name, uid=_read_uid(fields))
    return f"{namespace}/{name} is deleted: its pods stop, its domain and devices become free."


_WORK: Final[Mapping[str, Callable[[str, str, Fields, ApiClient], Awaitable[str]]]] = {
    "suspend": _suspend,
    "resume": _resume,
    "approve": _approve,
    "restart": _restart,
    "delete": _delete,
}


def _read_uid(fields: Fields) -> str:
    """Returns the uid of the app that the page showed. Raises RefusedInputError: without it another app of this name could be meant."""
    uid = fields.get("uid", "")
    if not uid:
        raise RefusedInputError("The form does not say which app it is about (uid): load the page again.")
    return uid


async def confirm_delete(request: web.Request) -> web.StreamResponse:
    """The page on which the name has to be typed."""
    console, caller = request.app[CONSOLE], request[CALLER]
    namespace, name = read_app(request)
    informers = await console.informers.get(caller.key, caller.endpoint)
    links = {"Back": path_of_app(namespace, name)}
    try:
        right = _RIGHTS["delete"](namespace, name)
        if not await informers.rights.is_granted(right):
            return console.answer_message(request, 403, "Not allowed", f"You may not {right.words}.", links=links)
        app = await informers.client.get(ROBOTAPPS, name, namespace=namespace)
    except NotFound:
        return console.answer_message(request, 404, "Nothing to delete", f"There is no RobotApp {namespace}/{name}.")
    except ClientError as error:
        return console.answer_message(request, 503, "Not known", clean(str(error)), links=links)
    counts = (app.get("status") or {}).get("instanceCounts") or {}
    context = {
        "title": f"Delete {namespace}/{name}",
        "path": path_of_app(namespace, name),
        "name": name,
        "namespace_of_app": namespace,
        "uid": app["metadata"]["uid"],
        "instances": counts.get("desired", 0),
    }
    return web.Response(text=console.render(request, "app_delete.html", context), content_type="text/html")


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
    await writes.annotate(client, NODES, name, {Annotation.GRACEFUL_SHUTDOWN: value}, uid=uid)
    if begin:
        return f"{name} is shutting down gracefully: it gets no new pods of RobotApps, and those on it go on."
    return f"The graceful shutdown of {name} has ended: it gets pods of RobotApps again."
