"""All RobotApps as a list, one decoded at a time: a page of large ones would be hundreds of megabytes as Python objects."""

from collections.abc import Callable, Sequence
from typing import Any, Final, TypedDict

import msgspec

from robotapp_client import ApiClient
from robotapp_client.api.client import Page
from robotapp_client.api.resources import ROBOTAPPS

Json = dict[str, Any]
PAGE: Final = 100
_EMPTY: Final = msgspec.Raw(b"{}")
_OBJECT: Final = msgspec.json.Decoder(Json)


class AppMeta(TypedDict, total=False):
    """The metadata of a Record, with its wire names."""

    name: str
    namespace: str
    uid: str
    generation: int
    resourceVersion: str
    creationTimestamp: str
    deletionTimestamp: str
    annotations: dict[str, str]


class StoredApp(msgspec.Struct):
    """A RobotApp without managedFields; spec and status as bytes."""

    metadata: AppMeta
    spec: msgspec.Raw = _EMPTY
    status: msgspec.Raw = _EMPTY

    def decode(self) -> Json:
        """The object as the watch delivers it."""
        return {
            "metadata": self.metadata,
            "spec": _OBJECT.decode(self.spec),
            "status": _OBJECT.decode(self.status),
        }


_PAGE: Final = msgspec.json.Decoder(Page[StoredApp])


async def list_apps(client: ApiClient, namespaces: Sequence[str], take: Callable[[Json], object]) -> set[str]:
    """Gives each RobotApp to `take` and returns their uids. `namespaces` empty: of the whole cluster."""
    uids: set[str] = set()
    for namespace in namespaces or (None,):
        own_uids: set[str] = set()
        async for page, again in client.pages(ROBOTAPPS.path(namespace), _PAGE.decode, page=PAGE):
            if again:
                own_uids.clear()
            for item in page.items or ():
                own_uids.add(item.metadata["uid"])
                take(item.decode())
        uids |= own_uids
    return uids
