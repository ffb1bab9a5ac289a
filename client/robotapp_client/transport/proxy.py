"""Finds the proxy that leads to an API server: `proxy-url` of the kubeconfig, else HTTPS_PROXY and NO_PROXY, by the rules of kubectl.

These are the rules of Go's `golang.org/x/net/http/httpproxy`, which client-go follows: the variable in capitals comes before
the small one, this machine is never reached through a proxy, and NO_PROXY holds names, domains, addresses and CIDRs. A
`proxy-url` counts whatever NO_PROXY says.
"""

import base64
import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final
from urllib.parse import SplitResult, unquote, urlsplit

from robotapp_client.transport.errors import LoginError

SOCKS: Final = ("socks5", "socks5h")
_PORTS: Final = {"http": 80, "https": 443, "socks5": 1080, "socks5h": 1080}
_LONGEST_SECRET: Final = 255
"""Bytes of a user name or password of SOCKS."""


@dataclass(frozen=True, slots=True)
class Proxy:
    """One proxy. `user` and `password` are empty where it wants none."""

    scheme: str
    host: str
    port: int
    user: str = field(default="", repr=False)
    password: str = field(default="", repr=False)

    def __str__(self) -> str:
        """Returns its address without the credentials, for messages."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"

    @property
    def authorization(self) -> str:
        """The value of Proxy-Authorization; empty without credentials."""
        if not self.user and not self.password:
            return ""
        return "Basic " + base64.b64encode(f"{self.user}:{self.password}".encode()).decode()


def find_proxy(server: str, environ: Mapping[str, str], *, proxy_url: str = "", where: str = "") -> Proxy | None:
    """Returns the proxy to a server, None where it is reached directly. `where` names the file of `proxy_url`. Raises LoginError."""
    if proxy_url:
        return parse_proxy(proxy_url, f"{where}: proxy-url" if where else "proxy-url", needs_scheme=True)
    parts = urlsplit(server)
    name = f"{parts.scheme.upper()}_PROXY"
    address = environ.get(name) or environ.get(name.lower(), "")
    if not address.strip():
        return None
    no_proxy = environ.get("NO_PROXY") or environ.get("no_proxy", "")
    port = parts.port or _PORTS.get(parts.scheme, 0)
    return None if is_direct(parts.hostname or "", port, no_proxy) else parse_proxy(address, name)


def parse_proxy(text: str, name: str, *, needs_scheme: bool = False) -> Proxy:
    """Returns the proxy of an address, such as http://user:password@proxy.example:3128. LoginError names `name`, never the text.

    The address may hold a password, so no message repeats it.
    """
    text = text.strip()
    if "://" not in text and not needs_scheme:
        text = f"http://{text}"
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        parts, port = SplitResult("", "", "", "", ""), None
    if parts.scheme not in _PORTS or not parts.hostname:
        raise LoginError(f"{name} is no address of a proxy; write http://, https:// or socks5://, a host and a port")
    user, password = unquote(parts.username or ""), unquote(parts.password or "")
    if max(len(user.encode()), len(password.encode())) > _LONGEST_SECRET:
        raise LoginError(f"{name} has a user name or password of more than {_LONGEST_SECRET} bytes")
    return Proxy(parts.scheme, parts.hostname, port or _PORTS[parts.scheme], user, password)


def is_direct(host: str, port: int, no_proxy: str) -> bool:
    """Returns whether a host is reached without a proxy: this machine always, others when NO_PROXY lists them."""
    host = host.lower().rstrip(".")
    address = _address(host)
    if host == "localhost" or (address is not None and address.is_loopback):
        return True
    entries = (entry.strip().lower() for entry in no_proxy.split(","))
    return any(_matches(entry, host, address, port) for entry in entries if entry)


def _matches(entry: str, host: str, address: ipaddress.IPv4Address | ipaddress.IPv6Address | None, port: int) -> bool:
    """Returns whether one entry of NO_PROXY is about the host: `*`, a CIDR, an address, a domain or a name, each with or without a port."""
    if entry == "*":
        return True
    network = _network(entry)
    if network is not None:
        return address is not None and address in network
    name, entry_port = _split_port(entry)
    if not name or (entry_port and entry_port != str(port)):
        return False
    entry_address = _address(name)
    if entry_address is not None:
        return address == entry_address
    suffix = name.removeprefix("*")
    return host.endswith(suffix) if suffix.startswith(".") else host == suffix or host.endswith(f".{suffix}")


def _split_port(entry: str) -> tuple[str, str]:
    """Returns host and port of an entry. An IPv6 address with a port is in brackets."""
    if entry.startswith("["):
        name, _, rest = entry[1:].partition("]")
        return name, rest.removeprefix(":")
    name, colon, port = entry.rpartition(":")
    return (name, port) if colon and ":" not in name else (entry, "")


def _network(text: str) -> ipaddress.IPv4Network | ipaddress.IPv6Network | None:
    try:
        return ipaddress.ip_network(text, strict=False) if "/" in text else None
    except ValueError:
        return None


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return None
    ipv4_address = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return ipv4_address or address
