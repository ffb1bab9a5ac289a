"""RobotClaims as an admin may write them: any thing, any holder, any state. The sweep must go on beside them."""

import random
import secrets
from collections.abc import Callable
from typing import Any, Final

from campaigns.fuzz.generator import Generator
from campaigns.rigs.world import APIS, Object, World
from robotapp_api.model.claim import RobotClaim
from robotapp_api.model.names import API_VERSION
from robotapp_api.schema.crd import schema_of
from robotapp_claims.rules.identity import claim_name_device, claim_name_domain
from robotapp_testbed.failures import ApiStatusError

PATH: Final = f"{APIS}/robotclaims"
LABELS: Final = {"fuzz": "claim"}
_LISTED: Final = f"{PATH}?labelSelector=fuzz%3Dclaim"
SENTINEL_ID: Final = 101


class Claims:
    """`living` names an app of the world that is there now, "" when there is none."""

    def __init__(self, world: World, make: Generator, *, seed: int, pool: str, living: Callable[[], str]) -> None:
        schema = schema_of(RobotClaim)["properties"]
        self._world = world
        self._make = make
        self._random = random.Random(seed)
        self._pool = pool
        self._living = living
        self._spec, self._status = schema["spec"], schema["status"]
        self._sentinel = ""

    def create(self) -> None:
        """One more; every third gets a random status, too. Raises `ApiStatusError` where it is refused."""
        body = self.object()
        self._world.cp.api.create(PATH, body)
        if self._random.random() < 1 / 3:
            status = self._make.value(self._status)
            self._world.cp.api.patch(f"{PATH}/{body['metadata']['name']}/status", {"status": status})

    def object(self) -> Object:
        spec = self._make.value({**self._spec, "required": ["domain", "device", "holder"]})
        if self._random.random() < 0.9:  # exactly one, or the API server refuses it
            self._mend(spec)
        name = _name_of(spec) if self._random.random() < 0.7 else f"fuzz-{secrets.token_hex(4)}"
        return _body(name, spec, LABELS)

    def _mend(self, spec: Object) -> None:
        spec.pop(self._random.choice(("domain", "device")))
        domain = spec.get("domain")
        if domain:
            domain["scopeValue"] = "" if domain["scope"] == "Cluster" else self._random.choice(("hall-1", "nowhere"))
            domain["pool"] = self._random.choice((self._pool, "nowhere", domain["pool"]))
        else:
            spec["device"]["node"] = self._random.choice((next(iter(self._world.nodes)).name, "nowhere"))
        holder = spec["holder"]
        namespace = self._world.namespace
        match self._random.randrange(4):
            case 0:  # of nobody any more
                holder |= _app_holder(namespace, "gone", secrets.token_hex(16))
            case 1 if name := self._living():
                holder |= _app_holder(namespace, name, self._world.app(name)["metadata"]["uid"])
            case 2:
                uid = secrets.token_hex(16)
                holder |= {"apiVersion": "v1", "kind": "Pod", "namespace": namespace, "name": "gone", "uid": uid}

    def begin(self) -> None:
        """A claim of an app that is gone, which the sweep must find beside all others."""
        domain = {"pool": self._pool, "scope": "Cluster", "scopeValue": "", "id": SENTINEL_ID}
        spec = {"domain": domain, "holder": _app_holder(self._world.namespace, "sentinel", secrets.token_hex(16))}
        name = claim_name_domain(self._pool, "Cluster", "", SENTINEL_ID)
        try:
            self._world.cp.api.create(PATH, _body(name, spec, {}))
            self._sentinel = name
        except ApiStatusError as error:
            if error.status != 409:  # one of the random ones took its id
                raise
            self._sentinel = ""

    @property
    def swept(self) -> bool:
        """Is the claim of `begin` gone?"""
        if not self._sentinel:
            return True
        try:
            found = self._world.cp.api.get(f"{PATH}/{self._sentinel}")
        except ApiStatusError as error:
            if error.status == 404:
                return True
            raise
        return bool(found["spec"]["holder"]["name"] != "sentinel")

    def clear(self) -> None:
        """Those that nothing ends: of holders of unknown kinds, and parked ones."""
        self._world.cp.api.delete(_LISTED)


def _body(name: str, spec: Object, labels: dict[str, str]) -> Object:
    return {"apiVersion": API_VERSION, "kind": "RobotClaim", "metadata": {"name": name, "labels": labels}, "spec": spec}


def _app_holder(namespace: str, name: str, uid: str) -> dict[str, Any]:
    return {"apiVersion": API_VERSION, "kind": "RobotApp", "namespace": namespace, "name": name, "uid": uid}


def _name_of(spec: Object) -> str:
    """The name that the thing has, as far as a name can have it."""
    if domain := spec.get("domain"):
        return claim_name_domain(domain["pool"], domain["scope"], domain.get("scopeValue", ""), domain["id"])
    return claim_name_device(spec["device"]["node"], spec["device"]["id"])
