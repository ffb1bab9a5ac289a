"""kubectl-robotapp against a small API server and a scheduler that answers from memory, both in a thread of their own."""

import asyncio
import json
import threading
from collections.abc import Coroutine
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import yaml
from aiohttp import web
from click.testing import Result
from tests.support.apiserver import FakeApiServer
from tests.support.apiserver.store import Key
from typer.testing import CliRunner

from robotapp_cli.main import app
from robotapp_client.serving.tls import TlsPort

T = TypeVar("T")
Json = dict[str, Any]
ROBOTAPPS = "robotics.io/robotapps"
INSTANCES = "robotics.io/robotappinstances"
UID = "11111111-2222-3333-4444-555555555555"
SUMMARY = {
    "ready": "2/2",
    "domain": "7",
    "robots": "1/1",
    "budget": "18/30ms",
    "devices": "1/1",
    "rmw": "rmw_fastrtps_cpp",
    "nodes": "amr-07",
}
STATUS = {
    "phase": "Running",
    "observedGeneration": 1,
    "summary": SUMMARY,
    "conditions": [
        {
            "type": "Ready",
            "status": "True",
            "reason": "AllComponentsReady",
            "message": "2 of 2",
            "lastTransitionTime": "2026-01-01T00:00:00Z",
        },
        {"type": "Stalled", "status": "False", "reason": "NotStalled"},
    ],
    "instanceCounts": {"desired": 1, "ready": 1},
}


class FakeScheduler:
    """GET /explain/<namespace>/<pod> from `records`, /simulate and /what-if as told; `status` other than 200 refuses everybody."""

    def __init__(self) -> None:
        self.records: dict[str, Json] = {}
        self.status = 200
        self.busy = 0
        """So many posted questions are refused with 429 first."""
        self.refusal: Json = {"error": "who are you"}
        self.wanted: Json = {"resources": []}
        self.outcome: Json = {}
        self.posted: list[bytes] = []
        self.queries: list[str] = []
        self.authorizations: list[str] = []
        self.url = ""
        self.tls_url = ""
        """The same with a certificate of its own making, as a scheduler has."""
        self._runner: web.AppRunner | None = None

    async def start(self) -> None:
        served = web.Application()
        served.router.add_get("/explain/{namespace}/{pod}", self._answer)
        served.router.add_get("/simulate", self._tell)
        served.router.add_post("/simulate", self._simulate)
        served.router.add_post("/what-if", self._simulate)
        self._runner = web.AppRunner(served, access_log=None, shutdown_timeout=0.1)
        await self._runner.setup()
        await web.TCPSite(self._runner, "127.0.0.1", 0).start()
        self.url = f"http://127.0.0.1:{self._runner.addresses[0][1]}"
        port = TlsPort()
        port.load()
        await web.TCPSite(self._runner, "127.0.0.1", 0, ssl_context=port.context).start()
        self.tls_url = f"https://127.0.0.1:{self._runner.addresses[1][1]}"

    async def stop(self) -> None:
        if self._runner:
            await self._runner.cleanup()

    async def _tell(self, _: web.Request) -> web.Response:
        if self.status != 200:
            return web.json_response(self.refusal, status=self.status)
        return web.json_response(self.wanted)

    async def _simulate(self, request: web.Request) -> web.Response:
        self.posted.append(await request.read())
        self.queries.append(request.query_string)
        if len(self.posted) <= self.busy:
            return web.json_response(self.refusal, status=429)
        if self.status != 200:
            return web.json_response(self.refusal, status=self.status)
        return web.json_response(self.outcome)

    async def _answer(self, request: web.Request) -> web.Response:
        self.authorizations.append(request.headers.get("Authorization", ""))
        if self.status != 200:
            return web.json_response({"error": "who are you"}, status=self.status)
        record = self.records.get(request.match_info["pod"])
        return web.json_response(record or {"error": "not seen"}, status=200 if record else 404)


class Stage:
    """`with Stage(tmp_path) as stage:` then `stage.add(obj)`, `stage.run("list")`."""

    def __init__(self, folder: Path) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self.api: FakeApiServer
        self.scheduler = FakeScheduler()
        self.kubeconfig = folder / "kubeconfig"

    def __enter__(self) -> Self:
        self._thread.start()
        self.api = self._do(self._serve())
        self._do(self.scheduler.start())
        self.kubeconfig.write_text(yaml.safe_dump(self._config()))
        return self

    async def _serve(self) -> FakeApiServer:
        return await FakeApiServer().__aenter__()  # made here because it takes the loop it is made in

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._do(self.scheduler.stop())
        self._do(self.api.__aexit__(kind, error, trace))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _do(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(timeout=10)

    def _config(self) -> Json:
        return {
            "apiVersion": "v1",
            "kind": "Config",
            "clusters": [{"name": "c", "cluster": {"server": self.api.endpoint.server}}],
            "users": [{"name": "u", "user": {"token": "t0ken"}}],
            "contexts": [{"name": "x", "context": {"cluster": "c", "user": "u", "namespace": "fleet"}}],
            "current-context": "x",
        }

    def add(self, path: str, *objects: Json) -> None:
        """Store objects as they are under their collection, such as `apps/deployments` or `/pods`."""
        for obj in objects:
            metadata = {"creationTimestamp": "2026-01-01T00:00:00Z", "resourceVersion": "1", **obj["metadata"]}
            key = Key(path, metadata.get("namespace", ""), metadata["name"])
            self.api.store.objects[key] = {**obj, "metadata": metadata}

    def run(self, *arguments: str, **environment: str) -> Result:
        env: dict[str, str | None] = {
            "KUBECONFIG": str(self.kubeconfig),
            "COLUMNS": "160",
            "ROBOTAPP_SCHEDULER_URL": None,
            **environment,
        }
        return CliRunner(env=env).invoke(app, list(arguments))

    def text(self, *arguments: str, **environment: str) -> str:
        """Output of a command that must succeed."""
        result = self.run(*arguments, **environment)
        assert result.exit_code == 0, result.output
        return result.stdout

    def data(self, *arguments: str, **environment: str) -> Any:
        return json.loads(self.text(*arguments, "-o", "json", **environment))


def robotapp(name: str = "teleop", *, namespace: str = "fleet", status: Json | None = None, **spec: Any) -> Json:
    components = [{"name": "driver", "image": "i"}, {"name": "panel", "image": "i"}]
    return {
        "metadata": {"name": name, "namespace": namespace, "uid": UID, "generation": 1},
        "spec": {"ros": {"distro": "humble"}, "components": components, **spec},
        "status": status or {},
    }


def instance(robot: str = "amr-07", *, uid: str = UID, app: str = "teleop", **status: Any) -> Json:
    """The RobotAppInstance of one robot, "" for an app without any."""
    labels = {"robotics.io/app": app, "robotics.io/app-uid": uid, "robotics.io/instance": robot}
    return {
        "metadata": {"name": f"{app}-{robot or 'only'}", "namespace": "fleet", "labels": labels},
        "spec": {"app": app, "appUID": uid, "instance": robot, "robot": robot},
        "status": status,
    }


def pod(name: str, component: str, *, node: str = "", instance: str = "amr-07", **status: Any) -> Json:
    labels = {"robotics.io/app-uid": UID, "robotics.io/component": component, "robotics.io/instance": instance}
    spec = {"nodeName": node} if node else {}
    return {"metadata": {"name": name, "namespace": "fleet", "labels": labels}, "spec": spec, "status": status}
