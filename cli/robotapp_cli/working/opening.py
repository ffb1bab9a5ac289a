"""`open`: a component's web page in the user's browser, through kubectl port-forward, wherever the cluster is."""

import contextlib
import sys
import webbrowser
from dataclasses import dataclass
from typing import Final

from robotapp_api.values.links import write_url
from robotapp_api.values.replicas import is_replica_name
from robotapp_cli.failures import CliError, Exit
from robotapp_cli.output import print_line
from robotapp_cli.reading.fields import Json
from robotapp_cli.reading.pods import MOST_LISTED, AppPod, Selection, explain_no_pods, fetch_app, list_pods
from robotapp_cli.reading.session import Session
from robotapp_client.tools.port_forward import ForwardError, NoKubectlError, forward_port

_PATIENCE_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class Target:
    """The port of a component's container, and how its address is written."""

    component: str
    link: str
    port: int | str
    """Number of the container's port, or its name."""
    scheme: str = "http"
    path: str = ""


async def open_component(session: Session, selection: Selection, link: str | None, *, browser: bool) -> None:
    """Forwards the port and opens its address, until Ctrl-C. Raises CliError when it is not clear what is meant."""
    app = await fetch_app(session, selection)
    target = choose_target(list_targets(app), selection, link)
    pods = await list_pods(
        session, app, Selection(selection.app, selection.component or target.component, selection.robot)
    )
    running_pods = [pod for pod in pods if pod.is_running]
    if not running_pods:
        raise explain_no_pods(session, app, selection)
    if len({pod.robot for pod in running_pods}) > 1:
        robots = ", ".join(list(dict.fromkeys(pod.robot for pod in running_pods))[:MOST_LISTED])
        raise CliError(f"{selection.app} runs on several robots ({robots}); name one with --robot", code=Exit.USAGE)
    await _forward(session, running_pods[0], target, browser=browser)


def list_targets(app: Json) -> list[Target]:
    """Returns what the app's components offer: their links, else the TCP ports that their containers name."""
    targets: list[Target] = []
    for component in app["spec"]["components"]:
        name = str(component["name"])
        service = component.get("service") or {}
        ports = {port["name"]: port for port in (service.get("spec") or {}).get("ports") or ()}
        for link in service.get("links") or ():
            port = ports[link["port"]]
            number = port.get("targetPort") or port["port"]
            targets.append(Target(name, link["name"], number, link.get("scheme", "http"), link.get("path", "")))
        if not service.get("links"):
            open_ports = [port for port in component.get("ports") or () if port.get("protocol", "TCP") == "TCP"]
            targets += [Target(name, port.get("name", ""), port["containerPort"]) for port in open_ports]
    return targets


def choose_target(targets: list[Target], selection: Selection, link: str | None) -> Target:
    """Returns the one target that is meant. Raises CliError with what there is."""
    matching_targets = [
        target
        for target in targets
        if (selection.component in (None, target.component) or is_replica_name(selection.component, target.component))
        and link in (None, target.link)
    ]
    if len(matching_targets) == 1:
        return matching_targets[0]
    if not targets:
        raise CliError(
            f"{selection.app} offers nothing to open: give a component service.links, or ports (docs/how-to/reach-a-component.md)",
            code=Exit.NOT_FOUND,
        )
    choices = ", ".join(
        " --link ".join(filter(None, (target.component, target.link))) for target in targets[:MOST_LISTED]
    )
    text = "offers several addresses" if matching_targets else "offers no such address"
    raise CliError(f"{selection.app} {text}; open one of: {choices}", code=Exit.USAGE)


def find_container_port(pod: AppPod, target: Target) -> int:
    """Returns the number of the port. Raises CliError for a name that the container's ports do not have."""
    if isinstance(target.port, int):
        return target.port
    ports = [port for container in pod.obj["spec"]["containers"] for port in container.get("ports") or ()]
    number = next((port["containerPort"] for port in ports if port.get("name") == target.port), None)
    if number is None:
        raise CliError(
            f"component {target.component} has no port named {target.port}; name it in ports", code=Exit.NOT_FOUND
        )
    return int(number)


async def _forward(session: Session, pod: AppPod, target: Target, *, browser: bool) -> None:
    """Runs kubectl port-forward until it ends or is interrupted. Raises CliError when it cannot begin."""
    number = find_container_port(pod, target)
    way = forward_port(
        session.home,
        pod.name,
        number,
        kubeconfig=session.options.kubeconfig,
        context=session.options.context,
        patience_s=_PATIENCE_S,
    )
    async with contextlib.AsyncExitStack() as stack:
        try:
            forward = await stack.enter_async_context(way)
        except NoKubectlError as error:
            raise CliError(f"{error}; open needs it on the PATH", code=Exit.USAGE) from error
        except ForwardError as error:
            raise CliError(str(error)) from error
        url = write_url(target.scheme, f"127.0.0.1:{forward.port}", target.path)
        print_line(f"{pod.title}: {url}   (Ctrl-C ends it)")
        sys.stdout.flush()
        if browser and target.scheme not in ("ws", "wss"):
            webbrowser.open(url)
        await forward.wait_closed()
    raise CliError(f"the connection to pod {pod.name} has ended: the pod, or kubectl, is gone; run the command again")
