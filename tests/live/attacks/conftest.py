"""A victim's namespace and an attacker's, with the chart's rights and policies: the attacker is `admin` of his own namespace."""

import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest
from tests.support.claims.objects import deployment_json
from tests.support.clients import client_for

from campaigns.rigs.claims_live import Live, live, until
from robotapp_claims.rules.identity import holder_of_app
from robotapp_claims.rules.objects import Holder
from robotapp_client import ApiClient, load
from robotapp_client.api.resources import DEPLOYMENTS, PODS, ROBOTAPPS
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.namespaces import created

Json = dict[str, Any]


@dataclass
class Attacker:
    """A tenant who writes whatever his rights allow in his own namespace."""

    client: ApiClient
    admin: ApiClient
    namespace: str
    node: str

    async def app(self, pool: str) -> Holder:
        body = {
            "metadata": {"name": "own", "namespace": self.namespace},
            "spec": {
                "ros": {"distro": "humble"},
                "components": [{"name": "driver", "image": "x"}],
                "ros2": {"pool": pool},
            },
        }
        uid = (await self.client.create(ROBOTAPPS, body))["metadata"]["uid"]
        return holder_of_app(namespace=self.namespace, name="own", uid=uid)

    async def deployment(
        self,
        name: str,
        number: int,
        *,
        uid: str,
        claim: str,
        app: str = "teleop",
        owned: bool = False,
        replicas: int = 0,
    ) -> Json:
        """With the labels of any app; `owned`: and with the owner reference."""
        body = deployment_json(number, uid=uid, name=name, claim=claim, app=app, replicas=replicas)
        template = body["spec"]["template"]
        template["metadata"]["labels"] = body["metadata"]["labels"] | {"forged": name}
        template["spec"]["containers"][0]["image"] = "x"
        template["spec"] |= {"schedulerName": "somebody", "terminationGracePeriodSeconds": 0}
        body["spec"]["selector"] = {"matchLabels": {"forged": name}}
        body["metadata"]["namespace"] = self.namespace
        if not owned:
            del body["metadata"]["ownerReferences"]
        return await self.client.create(DEPLOYMENTS, body, namespace=self.namespace)

    async def pods(self) -> list[Json]:
        return (await self.client.list(PODS, namespace=self.namespace, as_type=dict)).items

    async def run(self, count: int) -> None:
        """The attacker's pods run: a scheduler that makes no bind check has bound them."""

        async def made() -> bool:
            return len(await self.pods()) >= count

        await until(made)
        for pod in await self.pods():
            meta = pod["metadata"]
            body = {
                "apiVersion": "v1",
                "kind": "Binding",
                "metadata": {"name": meta["name"], "uid": meta["uid"]},
                "target": {"kind": "Node", "name": self.node},
            }
            await self.admin.post_raw(PODS.path(self.namespace, meta["name"], "binding"), msgspec.json.encode(body))


@pytest.fixture
async def place(installed_plane: ControlPlane, namespace: str) -> AsyncIterator[Live]:
    """The victim."""
    async with live(installed_plane, namespace) as found:
        await found.make_pool()
        yield found


@pytest.fixture
async def attacker(installed_plane: ControlPlane, place: Live) -> AsyncIterator[Attacker]:
    with created(installed_plane, f"attacker-{secrets.token_hex(3)}") as namespace:
        rights = ("rolebinding", "owner", "--clusterrole=admin", "--user=tenant", "-n", namespace)
        installed_plane.kubectl("create", *rights)
        async with client_for(load(installed_plane.kubeconfig("tenant")), timeout_s=20) as client:
            yield Attacker(client, place.admin, namespace, place.node)
