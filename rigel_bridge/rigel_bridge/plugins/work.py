"""What both plugin classes do: write what the Rigelfile becomes, and bring it into the cluster when the settings want that."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigel_bridge.cluster.deployment import deploy
from rigel_bridge.cluster.kubectl import Kubectl
from rigel_bridge.cluster.volume_claims import apply_claims
from rigel_bridge.cluster.waiting import Clock, duration_s, wait_ready
from rigel_bridge.document.failures import BridgeError, Exit, Place, control_character, printable
from rigel_bridge.render.text import as_yaml
from rigel_bridge.source import Objects

RIGELFILE: Final = Path("Rigelfile")
"""Rigel reads this file of the folder it runs in, and no other."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Of `kwargs` (Rigel 0.2) or `with` (0.3); everything else there is read from the Rigelfile, as `render` does."""

    output: Path | None = None
    apply: bool = False
    wait_s: float | None = None
    namespace: str = ""


@dataclass(frozen=True, slots=True)
class Done:
    """What was made: the file, and names for later jobs."""

    file: Path
    names: tuple[str, ...]
    namespace: str


def settings(raw: Mapping[str, Any], *, args: Sequence[Any] = ()) -> Settings:
    """The plugin's own settings; BridgeError for one that cannot be meant. `wait` means `apply`."""
    if args:
        raise _wrong("args", list(args), "nothing: settings stand in kwargs")
    output, wait, namespace = raw.get("output"), raw.get("wait"), raw.get("namespace")
    wait_s = duration_s(str(wait)) if wait is not None else None
    if wait is not None and wait_s is None:
        raise _wrong("wait", wait, "a duration up to 24h, for example 120s")
    if not isinstance(raw.get("apply", False), bool):
        raise _wrong("apply", raw["apply"], "true or false")
    if namespace is not None and not isinstance(namespace, str):
        raise _wrong("namespace", namespace, "the name of a namespace")
    return Settings(
        output=_below(output) if output is not None else None,
        apply=raw.get("apply", False) or wait_s is not None,
        wait_s=wait_s,
        namespace=namespace or "",
    )


def _below(output: Any) -> Path:
    path = Path(output) if isinstance(output, str) and output and not control_character(output) else Path("/")
    if path.is_absolute() or ".." in path.parts or path == RIGELFILE:
        raise _wrong("output", output, "a file below the folder of the Rigelfile, for example k8s/teleop.yaml")
    return path


def _wrong(key: str, value: Any, allowed: str) -> BridgeError:
    return BridgeError(Place(str(RIGELFILE)), f"{key}: {str(value)[:80]!r} is not allowed; allowed: {allowed}")


def write(objects: Objects, chosen: Settings) -> Done:
    """Write the same bytes as `rigel-bridge render`."""
    names = tuple(app["metadata"]["name"] for app in objects.apps)
    file = chosen.output or Path(f"{names[0]}.robotapp.yaml")
    text = as_yaml(objects.documents)
    _refuse_links(file)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BridgeError(Place(str(file)), f"cannot be written: {error.strerror}", code=Exit.UNREADABLE) from error
    return Done(file, names, chosen.namespace)


def _refuse_links(file: Path) -> None:
    """The folder is a checkout of somebody else's: a link in it may lead to any file of the user."""
    for path in (file, *file.parents):
        if path.is_symlink():
            raise BridgeError(
                Place(str(file)), f"{path} is a link, and output is never written through one; name another file"
            )


def deploy_all(objects: Objects, chosen: Settings, *, tell: Callable[[str], None]) -> Done:
    """Everything the settings want, one after the other."""
    done = write(objects, chosen)
    for note in objects.notes:
        tell(f"note: {note}")
    tell(f"{done.file}: written")
    if chosen.apply:
        kubectl = kubectl_of(chosen)
        bring(objects, kubectl=kubectl, tell=tell)
        wait(done, chosen, kubectl=kubectl, tell=tell)
    return done


def bring(objects: Objects, *, kubectl: Kubectl, tell: Callable[[str], None]) -> None:
    """Apply the claims and apps."""
    apply_claims(kubectl, objects.claims)
    for app in objects.apps:
        written = deploy(kubectl, app, tell=tell)
        tell(f"robotapp/{app['metadata']['name']}: {written.outcome}")


def wait(done: Done, chosen: Settings, *, kubectl: Kubectl, tell: Callable[[str], None]) -> None:
    """Return when the apps are Ready, as long as the settings allow."""
    for name in done.names if chosen.wait_s is not None else ():
        wait_ready(kubectl, name, timeout_s=chosen.wait_s or 0.0, clock=Clock(), tell=tell)
        tell(f"robotapp/{name}: Ready")


def kubectl_of(chosen: Settings) -> Kubectl:
    """The kubectl on PATH with its current context: Rigel has no place for other choices."""
    return Kubectl(flags=[f"--namespace={chosen.namespace}"] if chosen.namespace else [])


def tell(line: str) -> None:
    """One line for the user: both generations show what plugins write to standard output."""
    sys.stdout.write(f"{printable(line)}\n")
    sys.stdout.flush()
