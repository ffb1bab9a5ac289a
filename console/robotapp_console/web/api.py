"""The same data for programs: `/api/config` and `/api/nodes` as JSON, with the authentication of the pages."""

from collections.abc import Mapping
from typing import Any

import msgspec
from aiohttp import web

from robotapp_client import ClientError, Unauthorized
from robotapp_client.transport.errors import Forbidden
from robotapp_console.cluster.config_store import NotRecordedError, StaleError, StoredConfig
from robotapp_console.cluster.kinds import NODES_KINDS
from robotapp_console.views.nodes import NodeRow, build_nodes
from robotapp_console.views.snapshot import Refusal
from robotapp_console.views.texts import clean
from robotapp_console.web.console import CALLER, CONSOLE
from robotapp_console.web.signing import answer_expired
from robotapp_console.web.tuner import Tuner


async def answer_config(request: web.Request) -> web.Response:
    """The configuration, what the scheduler has made of it, and its versions."""
    tuner = await Tuner.open(request)
    try:
        config = await tuner.store.read()
    except Unauthorized:
        return answer_expired(request)
    return _answer_json(_describe_config(tuner, config), status=200 if config.text is not None else 404)


async def take_config(request: web.Request) -> web.Response:
    """Applies the text of the field `config`, if the ConfigMap still has the resourceVersion of the field `version`."""
    tuner = await Tuner.open(request)
    fields = await request.post()
    text, version = str(fields.get("config", "")), str(fields.get("version", ""))
    try:
        config = await tuner.store.read()
        if config.text is None:
            return _answer_json({"error": config.problem}, status=404)
        draft = await tuner.draft(config, text, None)
        if draft.problems:
            problems = [{"field": problem.field, "problem": problem.text} for problem in draft.problems]
            return _answer_json({"error": "the configuration cannot be used", "problems": problems}, status=422)
        if version and version != config.version:
            return _answer_stale()
        await tuner.store.apply(config, text, author=await tuner.find_author())
        return _answer_json(_describe_config(tuner, await tuner.store.wait_for_reload()))
    except StaleError:
        return _answer_stale()
    except NotRecordedError as error:
        return _answer_json({"error": f"applied, but not recorded: {error}", "maybeApplied": True}, status=502)
    except Unauthorized:
        return answer_expired(request)
    except Forbidden as error:
        return _answer_json({"error": clean(error.message)}, status=403)
    except ClientError as error:
        return _answer_json({"error": clean(str(error)), "maybeApplied": error.maybe_applied}, status=502)


async def answer_nodes(request: web.Request) -> web.Response:
    """The nodes as the screen of nodes shows them."""
    console, caller = request.app[CONSOLE], request[CALLER]
    informers = await console.informers.get(caller.key, caller.endpoint)
    await informers.use(NODES_KINDS, caller.home)
    if informers.signed_out:
        return answer_expired(request)
    _, nodes = informers.build_model(("nodes",), build_nodes, namespace="", home=caller.home)
    return _answer_json(
        {
            "nodes": [_describe_node(row) for row in nodes.rows],
            "notShown": [_describe_refusal(refusal) for refusal in nodes.refusals],
        }
    )


def _answer_stale() -> web.Response:
    return _answer_json({"error": "the configuration was changed by somebody else"}, status=409)


def _describe_config(tuner: Tuner, stored: StoredConfig) -> dict[str, Any]:
    place = tuner.console.config_place
    refusal = stored.refusal
    return {
        "namespace": place.namespace,
        "name": place.name,
        "resourceVersion": stored.version,
        "config": stored.text,
        "problem": stored.problem,
        "state": stored.state,
        "refusal": refusal.note if refusal is not None else "",
        "mayWrite": stored.text is not None and not stored.denied,
        "versions": [{"number": v.number, "at": v.at, "by": v.by} for v in stored.history],
    }


def _describe_node(row: NodeRow) -> dict[str, Any]:
    load = row.load
    return {
        "name": row.node,
        "robot": row.robot,
        "zone": row.zone,
        "tier": row.tier,
        "cpu": {"requestedMilli": row.cpu_requested, "allocatableMilli": row.cpu_milli, "percent": row.cpu_percent},
        "memory": {
            "requestedBytes": row.memory_requested,
            "allocatableBytes": row.memory_bytes,
            "percent": row.memory_percent,
        },
        "used": {
            "cpuPercent": load.cpu_percent if load else None,
            "memoryPercent": load.memory_percent if load else None,
        },
        "gracefulShutdown": row.shutting_down,
        "cordoned": row.cordoned,
        "notReadySince": row.not_ready_since,
        "agentHeardAt": row.reported_at,
        "devices": [{"id": d.id, "holder": d.holder, "present": d.present, "state": d.state} for d in row.devices],
    }


def _describe_refusal(refusal: Refusal) -> Mapping[str, str]:
    return {"what": refusal.what, "why": refusal.why, "cure": refusal.cure}


def _answer_json(content: Mapping[str, Any], *, status: int = 200) -> web.Response:
    return web.Response(status=status, body=msgspec.json.encode(content), content_type="application/json")
