"""A user with rights in a namespace of his own, who attacks everybody else from there."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

from campaigns.rigs.appwatch import condition
from campaigns.rigs.live import APPS
from campaigns.rigs.simulated_site import SimulatedSite
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.control_plane.namespaces import created

EDITOR: Final = "robotapp-editor"
"""May write RobotApps and their past specs, and nothing else."""

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Intruder:
    """`api` has the rights of one role in `namespace`."""

    namespace: str
    api: Api

    def create(self, app: Mapping[str, Any]) -> Json:
        """Creates a RobotApp and returns it as it is stored."""
        body = {**app, "metadata": {**app["metadata"], "namespace": self.namespace}}
        stored: Json = self.api.create(APPS.format(self.namespace), body)
        return stored

    def app(self, name: str) -> Json:
        stored: Json = self.api.get(f"{APPS.format(self.namespace)}/{name}")
        return stored

    def list_apps(self) -> list[Json]:
        items: list[Json] = self.api.get(APPS.format(self.namespace))["items"]
        return items

    def read_condition(self, name: str, kind: str) -> Mapping[str, Any]:
        """Returns a condition of an app, empty while it has none."""
        return condition(self.app(name), kind)


@contextmanager
def intruding(site: SimulatedSite, name: str, *, role: str = EDITOR) -> Iterator[Intruder]:
    """Makes a namespace, and in it an account that holds the ClusterRole; both are gone afterwards."""
    plane = site.cp
    with created(plane, f"{site.namespace}-{name}") as namespace:
        where = ("-n", namespace)
        plane.kubectl("create", "serviceaccount", "intruder", *where)
        account = f"--serviceaccount={namespace}:intruder"
        plane.kubectl("create", "rolebinding", "intruder", f"--clusterrole={role}", account, *where)
        token = plane.kubectl("create", "token", "intruder", *where).strip()
        api = Api(plane.server_url, ca_file=plane.ca_file, token=token)
        try:
            yield Intruder(namespace, api)
        finally:
            api.close()
