"""`exec` and `shell`: a program in a component's container with the environment that the component's own program has.

The image's entry point sources ROS, and perhaps a workspace, for its first process only; a program that kubectl starts
beside it has neither. The environment is therefore taken from that first process, which only its own user may read.
"""

import os
import sys
from collections.abc import Sequence
from typing import Final

from robotapp_cli.failures import CliError, Exit, ended_by
from robotapp_cli.reading.fields import Json
from robotapp_cli.reading.pods import (
    MOST_LISTED,
    AppPod,
    Selection,
    explain_no_pods,
    fetch_app,
    list_pods,
    name_selection,
)
from robotapp_cli.reading.session import Options, Session, run

_FROM_FIRST_PROCESS: Final = """\
if [ -r /proc/1/environ ]; then
  while IFS= read -r -d '' pair; do
    case $pair in
      TERM=*|PWD=*|OLDPWD=*|SHLVL=*|_=*) ;;
      [a-zA-Z_]*=*) export "$pair" 2>/dev/null ;;
    esac
  done < /proc/1/environ
fi
"""
_SET_UP: Final = """\
if [ -z "$AMENT_PREFIX_PATH$ROS_PACKAGE_PATH" ] && [ -f "/opt/ros/$ROS_DISTRO/setup.bash" ]; then
  . "/opt/ros/$ROS_DISTRO/setup.bash"
fi
export ROS_SUPER_CLIENT=TRUE
[ $# -gt 0 ] || set -- bash
exec "$@"
"""
"""The rest of the program for bash. A super client of a Fast DDS server is told all topics, an ordinary one only its own."""
_START: Final = """\
if command -v bash >/dev/null 2>&1; then exec bash -c "$0" bash "$@"; fi
export ROS_SUPER_CLIENT=TRUE
[ $# -gt 0 ] || set -- sh
exec "$@"
"""
"""Program for any shell; `$0` is the one for bash. An image without bash has no ROS to source."""


def enter_container(options: Options, selection: Selection, *, container: str | None, command: Sequence[str]) -> None:
    """Turns this process into `kubectl exec` of the command, or of a shell without one, in the selected container."""
    pod = run(options, lambda session: _choose_pod(session, selection))
    try:
        container = _choose_container(pod, container)
        arguments = build_exec_command(options, pod, container, command, is_terminal=sys.stdin.isatty())
        _become(arguments)
    except CliError as failure:
        raise ended_by(failure) from failure


def build_exec_command(
    options: Options, pod: AppPod, container: str, command: Sequence[str], *, is_terminal: bool
) -> list[str]:
    """Returns the command line of kubectl."""
    arguments = ["kubectl", "exec", "--stdin", *(["--tty"] if is_terminal else [])]
    arguments += [f"--namespace={pod.obj['metadata']['namespace']}", f"--container={container}"]
    arguments += [f"--context={options.context}"] if options.context else []
    arguments += [f"--kubeconfig={options.kubeconfig}"] if options.kubeconfig else []
    spec: Json = pod.obj["spec"]
    # The first process is then the pause container's, or the node's, and its environment is none of the container's.
    sees_others = spec.get("hostPID") or spec.get("shareProcessNamespace")
    program = _SET_UP if sees_others else _FROM_FIRST_PROCESS + _SET_UP
    return [*arguments, pod.name, "--", "sh", "-c", _START, program, *command]


async def _choose_pod(session: Session, selection: Selection) -> AppPod:
    """Returns the one running pod that is meant. Raises CliError when there is none or more than one component or robot."""
    app = await fetch_app(session, selection)
    pods = await list_pods(session, app, selection)
    if not pods:
        raise explain_no_pods(session, app, selection)
    titles = list(dict.fromkeys(pod.title for pod in pods))
    if len(titles) > 1:
        shown_titles = ", ".join(titles[:MOST_LISTED]) + (
            f" and {len(titles) - MOST_LISTED} more" if len(titles) > MOST_LISTED else ""
        )
        choices = " and ".join(_missing_choices(selection, pods))
        raise CliError(
            f"{name_selection(selection)} has several pods ({shown_titles}); name {choices}", code=Exit.USAGE
        )
    running_pods = [pod for pod in pods if pod.is_running]
    if not running_pods:
        raise CliError(
            f"no pod of {name_selection(selection)} is running; "
            f"{session.write_command('info', selection.app)} has the reason",
            code=Exit.NOT_FOUND,
        )
    return running_pods[0]


def _missing_choices(selection: Selection, pods: Sequence[AppPod]) -> list[str]:
    """Returns what would choose among the pods."""
    replica_or_component = "one of these replicas" if selection.component else "the component"
    choices = [replica_or_component] if len({pod.component for pod in pods}) > 1 else []
    return choices + (["--robot"] if len({pod.robot for pod in pods}) > 1 else [])


def _choose_container(pod: AppPod, container: str | None) -> str:
    """Returns the container's name: the main one without a wish. Raises CliError when the pod has no such container."""
    spec: Json = pod.obj["spec"]
    names = [str(entry["name"]) for key in ("containers", "initContainers") for entry in spec.get(key) or ()]
    if container is None:
        return pod.component if pod.component in names else names[0]
    if container not in names:
        raise CliError(f"pod {pod.name} has no container {container}; it has: {', '.join(names)}", code=Exit.NOT_FOUND)
    return container


def _become(arguments: list[str]) -> None:
    sys.stdout.flush()
    try:
        os.execvp(arguments[0], arguments)  # noqa: S606 - no shell on this machine
    except OSError as error:
        raise CliError(
            f"kubectl cannot be started: {error.strerror}; exec and shell need it on the PATH", code=Exit.USAGE
        ) from error
