"""Fields of a service about the node, privileges and the network: host modes, capabilities, ports, names, DNS."""

import ipaddress
import re
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from robotapp_cli.importing.files.parts import Part
from robotapp_cli.importing.services.draft import Draft, Json, format_bytes, make_label, read_bytes, report_fields

_CAPABILITY: Final = re.compile(r"[A-Z][A-Z0-9_]*")
_PORT: Final = re.compile(r"(?:(?P<host>.*):)?(?P<port>\d+(?:-\d+)?)(?:/(?P<protocol>\w+))?")
_MOST_SERVICE_PORTS: Final = 16
_MOST_IN_RANGE: Final = 64
_LABEL: Final = re.compile(r"[a-z0-9]([-a-z0-9]*[a-z0-9])?")
_ULIMITS: Final = {
    "rtprio": "add the capability SYS_NICE",
    "rttime": "add the capability SYS_NICE",
    "nice": "add the capability SYS_NICE",
    "memlock": "add the capability IPC_LOCK",
}


def take_network_mode(draft: Draft, part: Part) -> None:
    """Takes the network of the node; other modes have no meaning in a cluster."""
    mode = part.as_text()
    if mode == "host":
        draft.pod["hostNetwork"] = True
        draft.report.take(part, "hostNetwork: true, which takes the right robotapps/hostnetwork")
    elif mode in {"bridge", "default", ""}:
        draft.report.take(part, "a pod has a network of its own")
    elif mode.startswith(("service:", "container:")):
        text = "only containers of one pod share a network; write this one under template.spec.containers of the other"
        draft.report.omit(part, text)
    else:
        draft.report.omit(part, f"no pod can have the network {mode}; a NetworkPolicy keeps it from others")


def take_ipc(draft: Draft, part: Part) -> None:
    """Takes the shared memory of the node."""
    _take_host_mode(draft, part, "hostIPC", "sharedMemory, or one pod with both programs")


def take_pid(draft: Draft, part: Part) -> None:
    """Takes the processes of the node."""
    _take_host_mode(draft, part, "hostPID", "one pod with shareProcessNamespace")


def _take_host_mode(draft: Draft, part: Part, field: str, instead: str) -> None:
    mode = part.as_text()
    if mode == "host":
        draft.pod[field] = True
        draft.report.take(part, f"{field}: true, which takes the right robotapps/{field.lower()}")
    elif mode in {"private", "shareable", ""}:
        draft.report.take(part, "a pod has its own")
    else:
        draft.report.omit(part, f"pods do not share it with each other; write {instead}")


def take_privileged(draft: Draft, part: Part) -> None:
    """Takes all privileges, where they are asked for."""
    if part.as_bool():
        draft.secure("privileged", True)
        draft.report.take(part, "securityContext.privileged: true, which takes the right robotapps/privileged")
    else:
        draft.report.take(part, "nothing is written: not privileged is the default")


def take_capabilities(draft: Draft, part: Part) -> None:
    """Takes cap_add and cap_drop."""
    field = str(part.path[-1]).removeprefix("cap_")
    names = []
    for item in part.as_items():
        name = item.as_text().upper().removeprefix("CAP_")
        if not _CAPABILITY.fullmatch(name):
            raise item.fail(f"{item.as_text()[:40]!r} is no capability; write for example NET_ADMIN")
        names.append(name)
        draft.report.take(item, f"securityContext.capabilities.{field}: {name}")
    context = draft.fields.setdefault("securityContext", {})
    context.setdefault("capabilities", {})[field] = list(dict.fromkeys(names))


def take_security_opt(draft: Draft, part: Part) -> None:
    """Takes unconfined profiles and no-new-privileges."""
    for item in part.as_items():
        name, _, value = item.as_text().replace("=", ":", 1).partition(":")
        if name in {"seccomp", "apparmor"} and value == "unconfined":
            field = "seccompProfile" if name == "seccomp" else "appArmorProfile"
            draft.secure(field, {"type": "Unconfined"})
            draft.report.take(item, f"securityContext.{field}: Unconfined")
        elif name == "no-new-privileges":
            draft.secure("allowPrivilegeEscalation", value == "false")
            draft.report.take(item, f"securityContext.allowPrivilegeEscalation: {str(value == 'false').lower()}")
        else:
            draft.report.omit(
                item, "this profile is on the machine; write seccompProfile, appArmorProfile or seLinuxOptions"
            )


def take_read_only(draft: Draft, part: Part) -> None:
    """Takes the read-only root file system."""
    if part.as_bool():
        draft.secure("readOnlyRootFilesystem", True)
    draft.report.take(part, f"securityContext.readOnlyRootFilesystem: {part.as_text()}")


def take_group_add(draft: Draft, part: Part) -> None:
    """Takes numbers of groups; names are in the image alone."""
    for item in part.as_items():
        text = item.as_text()
        if text.isascii() and text.isdigit():
            context = draft.pod.setdefault("securityContext", {})
            context.setdefault("supplementalGroups", []).append(int(text))
            draft.report.take(item, f"supplementalGroups: {text}")
        else:
            draft.report.omit(
                item, f"{text!r} is a name, which only the image has; write its number (getent group {text})"
            )


def take_sysctls(draft: Draft, part: Part) -> None:
    """Takes kernel settings of the pod."""
    for name, value, _ in part.list_pairs():
        if draft.is_on_host_network and name.startswith("net."):
            draft.report.omit(value, f"{name} is that of the node with hostNetwork; set it there")
            continue
        entry = {"name": name, "value": value.as_text()}
        draft.pod.setdefault("securityContext", {}).setdefault("sysctls", []).append(entry)
        draft.report.take(value, f"securityContext.sysctls: {name}; the kubelet admits only safe ones by itself")


def take_ulimits(draft: Draft, part: Part) -> None:
    """Reports limits, which no field of Kubernetes sets."""
    for name, value in part.as_fields().items():
        cure = _ULIMITS.get(name, f"raise it in a shell before the program, with ulimit ({name})")
        draft.report.omit(value, f"no field of Kubernetes sets {name}; {cure} (docs/how-to/reach-the-node.md)")


def take_shm_size(draft: Draft, part: Part) -> None:
    """Takes the size of /dev/shm; with the node's own there is nothing to set."""
    mode = draft.service.get("ipc")
    if mode is not None and mode.as_text() == "host":
        draft.report.omit(part, "with hostIPC the shared memory is the node's")
        return
    size = format_bytes(read_bytes(part))
    draft.fields["sharedMemory"] = {"size": size}
    draft.report.take(part, f"sharedMemory.size: {size}")


class Port(NamedTuple):
    """One port of a container; `outside` is the one under which others reach it."""

    inside: int
    outside: int
    protocol: str
    address: str = ""


def take_ports(draft: Draft, part: Part) -> None:
    """Ports become ports of the container and of the component's Service."""
    for item in part.as_items():
        if item.unset and not _PORT.fullmatch(item.as_text() if item.fields is None else "0"):
            draft.report.omit(item, f"{item.unset[0]} has no value here; give --env {item.unset[0]}=PORT")
            continue
        ports = list(_read_ports(draft, item))
        if len(ports) > _MOST_IN_RANGE:
            draft.report.omit(
                item, f"a range of {len(ports)} ports; write hostNetwork: true, with which all are reached"
            )
            continue
        text = ", ".join(str(port.outside) for port in ports[:4]) + ("…" if len(ports) > 4 else "")
        full = [port for port in ports if not _add_port(draft, port)]
        if full:
            text = f"a Service has {_MOST_SERVICE_PORTS} ports at most; {len(full)} of these are not in it"
            draft.report.change(item, text)
        elif ports and ports[0].address:
            draft.report.change(
                item, f"service port {text}; a Service is reached by all pods, not by {ports[0].address}"
            )
        else:
            draft.report.take(item, f"service port {text}, reached inside the cluster")


def take_expose(draft: Draft, part: Part) -> None:
    """Takes ports that other services reach."""
    for item in part.as_items():
        for port in _read_ports(draft, item):
            _add_port(draft, port)
        draft.report.take(item, "service port, reached inside the cluster")


def _read_ports(draft: Draft, item: Part) -> Iterator[Port]:
    """Yields the ports of an entry in its short or long form."""
    if item.fields is not None:
        target, outside = item.get("target"), item.get("published")
        if target is None:
            raise item.fail("a port needs a target; write target: 8080")
        protocol = item.get("protocol")
        address = item.get("host_ip")
        reasons = {"mode": "a Service has no such mode", "name": "names of ports are made from their numbers"}
        reasons["app_protocol"] = "write service.spec.ports[].appProtocol where a Gateway reads it"
        report_fields(draft, item, frozenset({"target", "published", "protocol", "host_ip"}), reasons)
        text = f"{outside.as_text()}:" if outside else ""
        text += target.as_text() + (f"/{protocol.as_text()}" if protocol else "")
        host = address.as_text() if address else ""
    else:
        text, host = item.as_text(), ""
    match = _PORT.fullmatch(text)
    if match is None:
        raise item.fail(f"{text[:60]!r} is no port; write for example 8080:80 or 5000-5010:5000-5010/udp")
    protocol_name = (match["protocol"] or "tcp").upper()
    before, _, published_text = (match["host"] or "").rpartition(":")
    inside = _read_range(item, match["port"])
    outside_range = _read_range(item, published_text) if published_text else inside
    if protocol_name not in {"TCP", "UDP", "SCTP"}:
        raise item.fail(f"{protocol_name} is no protocol; write tcp, udp or sctp")
    if len(inside) > 1 and len(inside) != len(outside_range):
        raise item.fail("the two ranges have different lengths; write as many ports on both sides")
    for position, number in enumerate(inside):
        yield Port(number, outside_range[position], protocol_name, host or before)


def _read_range(item: Part, text: str) -> range:
    first, _, last = text.partition("-")
    if not first.isdigit() or (last and not last.isdigit()):
        raise item.fail(f"{text[:40]!r} is no port; write a number from 1 to 65535, or two with - between")
    numbers = range(int(first), int(last or first) + 1)
    if not numbers or numbers[0] < 1 or numbers[-1] > 65535:
        raise item.fail(f"{text[:40]!r} is no port; write numbers from 1 to 65535, the lower one first")
    return numbers


def _add_port(draft: Draft, port: Port) -> bool:
    """Adds the port unless it is there already; false where the Service has no room for it."""
    name = f"{port.protocol.lower()}-{port.inside}"
    ports = draft.fields.setdefault("ports", [])
    if all(other["name"] != name for other in ports):
        udp = {} if port.protocol == "TCP" else {"protocol": port.protocol}
        ports.append({"name": name, "containerPort": port.inside, **udp})
    entries = draft.fields.setdefault("service", {"spec": {"ports": []}})["spec"]["ports"]
    if any(other["port"] == port.outside and other.get("protocol", "TCP") == port.protocol for other in entries):
        return True
    if len(entries) >= _MOST_SERVICE_PORTS:
        return False
    entry: Json = {"name": f"{port.protocol.lower()}-{port.outside}", "port": port.outside}
    entry |= {} if port.protocol == "TCP" else {"protocol": port.protocol}
    entries.append(entry if port.inside == port.outside else {**entry, "targetPort": port.inside})
    return True


def take_extra_hosts(draft: Draft, part: Part) -> None:
    """Takes lines of /etc/hosts."""
    by_address: dict[str, list[str]] = {}
    for name, address, item in _list_hosts(part):
        try:
            text = str(ipaddress.ip_address(address.strip("[] ")))
        except ValueError:
            cure = (
                "the node's address is status.hostIP of the pod"
                if address == "host-gateway"
                else "write its IP address"
            )
            draft.report.omit(item, f"{address or 'nothing'} is no address; {cure}")
            continue
        by_address.setdefault(text, []).append(name)
        draft.report.take(item, f"hostAliases: {name} is {text}")
    if by_address:
        draft.pod["hostAliases"] = [{"ip": address, "hostnames": names} for address, names in by_address.items()]


def _list_hosts(part: Part) -> Iterator[tuple[str, str, Part]]:
    for name, value in (part.fields or {}).items():
        for item in value.as_items():
            yield name, item.as_text(), item
    for item in part.as_items() if part.fields is None else ():
        text = item.as_text()
        name, _, address = text.partition("=" if "=" in text else ":")
        yield name.strip(), address, item


def take_dns(draft: Draft, part: Part) -> None:
    """Takes DNS servers, search domains and options."""
    field = {"dns": "nameservers", "dns_search": "searches", "dns_opt": "options"}[str(part.path[-1])]
    values: list[Any] = []
    for item in part.as_items():
        name, colon, value = item.as_text().partition(":")
        option = {"name": name, "value": value} if colon else {"name": name}
        values.append(option if field == "options" else item.as_text())
        draft.report.take(item, f"dnsConfig.{field}")
    if values:
        draft.pod.setdefault("dnsConfig", {})[field] = values


def take_hostname(draft: Draft, part: Part) -> None:
    """Takes the host name where it can be that of a pod."""
    text = part.as_text()
    if draft.is_on_host_network:
        draft.report.omit(part, "with hostNetwork the host name is the node's")
    elif _LABEL.fullmatch(text) and len(text) <= 63:
        draft.pod["hostname"] = text
        draft.report.take(part, "hostname")
    else:
        draft.pod["hostname"] = make_label(text)
        draft.report.change(part, f"hostname: {make_label(text)}; a pod's has small letters, digits and -")


def take_networks(draft: Draft, part: Part) -> None:
    """Reports networks: all pods of a cluster reach each other, and domains keep apps apart."""
    entries = part.fields.values() if part.fields is not None else part.as_items()
    for item in entries:
        draft.report.omit(
            item, "all pods reach each other; the domain keeps ROS apart, a NetworkPolicy everything else"
        )
