"""A transport that requests only the metadata of objects: a reader of names need not hold the rest.

A list page of full ConfigMaps may be 500 MiB; the metadata of the same page are a few hundred kilobytes.
"""

from typing import Final

from robotapp_client.transport.http_transport import HttpTransport

_AS: Final = "application/json;g=meta.k8s.io;v=v1;as="
_ONE: Final = f"{_AS}PartialObjectMetadata"
_LIST: Final = f"{_AS}PartialObjectMetadataList"


class MetadataTransport(HttpTransport):
    """For reflectors alone: what is not a watch is requested as a list, so objects cannot be read by name."""

    def _accept(self, path: str) -> str:
        return _ONE if "watch=1" in path.partition("?")[2].split("&") else _LIST
