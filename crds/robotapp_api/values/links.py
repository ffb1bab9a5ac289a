"""Addresses of a component as people open them in a browser."""

from typing import Final
from urllib.parse import quote

FOXGLOVE: Final = "https://app.foxglove.dev/?ds={source}&ds.url={address}"
SOURCES: Final = {"foxglove": "foxglove-websocket", "rosbridge": "rosbridge-websocket"}
"""Schemes that mean Foxglove in the browser → its name for the kind of server."""


def write_url(scheme: str, address: str, path: str) -> str:
    """Returns the address as a browser opens it. `address` is host and port."""
    if source := SOURCES.get(scheme):
        return FOXGLOVE.format(source=source, address=quote(f"ws://{address}{path}", safe=""))
    return f"{scheme}://{address}{path}"
