"""The commands that work with a running app: logs, exec, shell, open, restart, suspend, resume."""

from typing import Annotated

import typer

from robotapp_cli.arguments import Context, Kubeconfig, Name, Namespace, OptionalComponent, Robot
from robotapp_cli.completion import complete_components
from robotapp_cli.reading.pods import Selection
from robotapp_cli.reading.session import Options, run
from robotapp_cli.working.changing import restart_components, set_suspended
from robotapp_cli.working.entering import enter_container
from robotapp_cli.working.logs import LogOptions, show_logs
from robotapp_cli.working.opening import open_component
from robotapp_cli.written import object_name

Component = Annotated[
    str | None,
    typer.Option(
        "--component",
        "-c",
        help="Component (default: the only one).",
        autocompletion=complete_components,
        callback=object_name,
    ),
]
Container = Annotated[
    str | None,
    typer.Option("--container", help="Another container of the pod, such as a sidecar.", callback=object_name),
]


def add_working_commands(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.command(
        "logs", epilog="Examples: kubectl robotapp logs teleop -f; kubectl robotapp logs patrol plan --robot amr-07"
    )(logs_command)
    app.command(
        "exec",
        epilog="Example: kubectl robotapp exec teleop -c driver -- ros2 topic list --no-daemon --spin-time 3",
    )(exec_command)
    app.command("shell", epilog="Example: kubectl robotapp shell teleop driver")(shell_command)
    app.command(
        "open", epilog="Examples: kubectl robotapp open teleop; kubectl robotapp open patrol map --robot amr-07"
    )(open_command)
    app.command("restart", epilog="Examples: kubectl robotapp restart teleop; kubectl robotapp restart teleop driver")(
        restart_command
    )
    app.command("suspend", epilog="Example: kubectl robotapp suspend teleop")(suspend_command)
    app.command("resume", epilog="Example: kubectl robotapp resume teleop")(resume_command)


def logs_command(
    name: Name,
    component: OptionalComponent = None,
    *,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on with what is written, until Ctrl-C.")] = False,
    tail: Annotated[int, typer.Option("--tail", min=-1, help="So many last lines of each container; -1: all.")] = 100,
    since: Annotated[str, typer.Option("--since", help="Only lines that are not older, such as 90s or 10m.")] = "",
    previous: Annotated[
        bool, typer.Option("--previous", "-p", help="Of the container's previous run, the one that ended.")
    ] = False,
    timestamps: Annotated[bool, typer.Option("--timestamps", help="Begin each line with its time.")] = False,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Print what all containers of an app wrote, in the order of time, each line with robot and component."""
    log_options = LogOptions(follow=follow, tail=tail, since=since, previous=previous, timestamps=timestamps)
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig),
        lambda session: show_logs(session, Selection(name, component, robot), log_options),
    )


def exec_command(
    name: Name,
    command: Annotated[list[str], typer.Argument(metavar="-- COMMAND...", help="Program with its arguments.")],
    *,
    component: Component = None,
    container: Container = None,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Run a program in a component's container with the environment its own program has, so that ros2 and rosnode work."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig)
    enter_container(options, Selection(name, component, robot), container=container, command=command)


def shell_command(
    name: Name,
    component: OptionalComponent = None,
    *,
    container: Container = None,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Open a shell in a component's container with the environment its own program has, so that ros2 topic list works."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig)
    enter_container(options, Selection(name, component, robot), container=container, command=[])


def open_command(
    name: Name,
    component: OptionalComponent = None,
    *,
    link: Annotated[
        str | None, typer.Option("--link", help="One of the component's links.", callback=object_name)
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser.")] = True,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Open a link of a component, or its port, in the browser through kubectl port-forward, until Ctrl-C."""
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig),
        lambda session: open_component(session, Selection(name, component, robot), link, browser=browser),
    )


def restart_command(
    name: Name,
    component: OptionalComponent = None,
    *,
    robot: Robot = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Replace the pods of an app, or of one component, as a change of its template would; a job runs once more."""
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig),
        lambda session: restart_components(session, Selection(name, component, robot)),
    )


def suspend_command(
    name: Name, *, namespace: Namespace = None, context: Context = None, kubeconfig: Kubeconfig = None
) -> None:
    """Stop all pods of an app: it keeps its domain and gives its devices back."""
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig),
        lambda session: set_suspended(session, name, suspend=True),
    )


def resume_command(
    name: Name, *, namespace: Namespace = None, context: Context = None, kubeconfig: Kubeconfig = None
) -> None:
    """Start a suspended app again."""
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig),
        lambda session: set_suspended(session, name, suspend=False),
    )
