"""The addresses of an instance's `service.links`: which of them a browser may follow, and how the others are reached."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qs, urlsplit

from robotapp_console.views.objects import InstanceLink
from robotapp_console.views.texts import clean, kubectl

MOST_LINKS: Final = 32
_MOST_CHARACTERS: Final = 1024
_FOLLOWED: Final = frozenset({"http", "https", "foxglove"})
_FOXGLOVE_SERVER: Final = "ds.url"
"""The part of Foxglove's address in the browser that names the server to connect to."""
_POD_NETWORK: Final = ".svc"
"""End of the name of a Service without an address outside of the cluster, as the operator writes it."""


@dataclass(frozen=True, slots=True)
class LinkRow:
    """One link. `href` is empty where a browser cannot follow the address, or must not."""

    component: str
    name: str
    address: str
    href: str
    command: str
    """What opens it from the user's machine; empty for a link that is reached from outside of the cluster."""


def build_links(links: Iterable[InstanceLink], *, namespace: str, app: str, robot: str) -> tuple[LinkRow, ...]:
    """Returns a row per link, in the order of the status."""
    return tuple(
        _build_link(link, namespace=namespace, app=app, robot=robot)
        for link, _ in zip(links, range(MOST_LINKS), strict=False)
    )


def _build_link(link: InstanceLink, *, namespace: str, app: str, robot: str) -> LinkRow:
    is_inside = _is_inside(link.url)
    on_robot = ("--robot", robot) if robot else ()
    words = ("robotapp", "open", app, link.component, "--link", link.name, "-n", namespace, *on_robot)
    return LinkRow(
        clean(link.component, 63),
        clean(link.name, 63),
        clean(link.url, _MOST_CHARACTERS),
        link.url if is_followed(link.url) and not is_inside else "",
        kubectl(*words) if is_inside else "",
    )


def is_followed(url: str) -> bool:
    """Returns whether the page makes an anchor of the address: http, https or foxglove with a host, and shown as it is written.

    Whoever writes an app or a Service decides about it. So nothing may hide where it leads: no user before the host, no blank,
    no backslash (browsers read it as a slash), no character that is shown as an escape.
    """
    if (
        len(url) > _MOST_CHARACTERS
        or not url.isascii()
        or not url.isprintable()
        or any(mark in url for mark in ' \\"<>')
    ):
        return False
    try:
        address = urlsplit(url)
        host = address.hostname
    except ValueError:  # brackets that are no IPv6 address
        return False
    return address.scheme in _FOLLOWED and bool(host) and "@" not in address.netloc


def _is_inside(url: str) -> bool:
    """Returns whether only pods of the cluster reach it: a Service's name, also as the server that Foxglove is to connect to."""
    try:
        address = urlsplit(url)
        server = parse_qs(address.query).get(_FOXGLOVE_SERVER, [""])[0]
        hosts = (address.hostname, urlsplit(server).hostname)
    except ValueError:
        return False
    return any((host or "").endswith(_POD_NETWORK) for host in hosts)
