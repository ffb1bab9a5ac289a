"""`kubectl-robotapp`, which kubectl finds as `kubectl robotapp`."""

from collections.abc import Awaitable
from pathlib import Path
from typing import Annotated

import typer

from robotapp_api.model.names import SYSTEM_NAMESPACE
from robotapp_cli.arguments import (
    Context,
    Everywhere,
    Kubeconfig,
    Name,
    Namespace,
    OutputFormat,
    Robot,
    SchedulerNamespace,
    SchedulerUrl,
    Watching,
)
from robotapp_cli.commands.apps import show_info, show_list
from robotapp_cli.commands.claims import show_domains
from robotapp_cli.commands.console import ConsoleOptions, start_console
from robotapp_cli.commands.devices import show_devices
from robotapp_cli.commands.explain import Question, show_explain
from robotapp_cli.commands.imports.command import add_import_command
from robotapp_cli.commands.nodes import show_nodes, show_robots
from robotapp_cli.commands.rendering import show_children, show_file
from robotapp_cli.commands.simulate import Wish, show_simulation
from robotapp_cli.commands.watching import watch
from robotapp_cli.commands.what_if import WhatIfRequest, show_what_if
from robotapp_cli.completion import complete_names, complete_nodes, complete_pairs
from robotapp_cli.failures import CliError, Exit, ended_by
from robotapp_cli.output import Output
from robotapp_cli.reading.session import Options, Session, run
from robotapp_cli.verbs import Verbs, print_version
from robotapp_cli.working.bags import add_bag_commands
from robotapp_cli.working.commands import add_working_commands
from robotapp_cli.working.runs import add_runs_command
from robotapp_cli.written import object_name

_EPILOG = """\
Exit codes: 0 done; 1 refused by the API server, or errors found by lint; 2 wrong usage or unreadable file; 3 API server not reached or not signed in; 4 not found.

Colour only on a terminal (NO_COLOR is respected). kubectl completes "kubectl robotapp" by kubectl_complete-robotapp on the PATH; for kubectl-robotapp itself: --install-completion
"""

app = typer.Typer(
    name="kubectl robotapp",
    cls=Verbs,
    help="RobotApps, their placement, DDS domains and devices.",
    epilog=_EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def show_version(
    *,
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=print_version)
    ] = False,
) -> None:
    """RobotApps, their placement, DDS domains and devices."""


@app.command("list", epilog="Example: kubectl robotapp list -A -o wide")
def list_command(
    *,
    namespace: Namespace = None,
    everywhere: Everywhere = False,
    watching: Watching = False,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """List RobotApps with domain, latency and devices."""
    run(
        Options(namespace=namespace, everywhere=everywhere, context=context, kubeconfig=kubeconfig, output=output),
        lambda session: watch(session, show_list) if watching else show_list(session),
    )


@app.command("info", epilog="Examples: kubectl robotapp info teleop -w; kubectl robotapp info patrol --robot amr-07")
def info_command(
    name: Name,
    *,
    robot: Robot = None,
    watching: Watching = False,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Show one RobotApp: conditions, instances, edges with their latency, events."""

    def show(session: Session) -> Awaitable[None]:
        return show_info(session, name, robot)

    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output),
        lambda session: watch(session, show) if watching else show(session),
    )


@app.command("explain", epilog="Example: kubectl robotapp explain teleop --component operator-ui -o wide")
def explain_command(
    name: Name,
    *,
    component: Annotated[str | None, typer.Option("--component", "-c", help="Only this component.")] = None,
    robot: Robot = None,
    scheduler_url: SchedulerUrl = None,
    scheduler_namespace: SchedulerNamespace = SYSTEM_NAMESPACE,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Say why each component runs where it runs, and which nodes were refused."""
    question = Question(
        name=name,
        component=component,
        robot=robot,
        scheduler_url=scheduler_url,
        scheduler_namespace=scheduler_namespace,
    )
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output),
        lambda session: show_explain(session, question),
    )


@app.command(
    "simulate",
    epilog="Examples: kubectl robotapp simulate pods.yaml; kubectl robotapp simulate --replay 100 --config other-weights.yaml",
)
def simulate_command(
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILE]...", help="YAML or JSON with pods to try (- for standard input)."),
    ] = None,
    *,
    config: Annotated[
        Path | None, typer.Option("--config", help="KubeSchedulerConfiguration to try (default: the running one).")
    ] = None,
    replay: Annotated[int, typer.Option("--replay", min=0, help="Place the latest N bound pods again, too.")] = 0,
    offline: Annotated[
        bool,
        typer.Option(
            "--offline", help="The files are the whole cluster: read nothing else. The running scheduler still decides."
        ),
    ] = False,
    scheduler_url: SchedulerUrl = None,
    scheduler_namespace: SchedulerNamespace = SYSTEM_NAMESPACE,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Say where waiting pods, and those of files, would go; nothing is placed."""
    wish = Wish(
        files=tuple(files or ()),
        offline=offline,
        config=config,
        replay=replay,
        scheduler_url=scheduler_url,
        scheduler_namespace=scheduler_namespace,
    )
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output),
        lambda session: show_simulation(session, wish),
    )


@app.command(
    "what-if",
    epilog="Examples: kubectl robotapp what-if --node-loss edge-1; kubectl robotapp what-if --rtt edge-1:amr-07=40ms -o json; "
    "kubectl robotapp what-if --replay 200 --config other-weights.yaml",
)
def what_if_command(
    *,
    node_loss: Annotated[
        list[str] | None,
        typer.Option(
            "--node-loss", metavar="NODE", help="This node is lost. Can be repeated.", autocompletion=complete_nodes
        ),
    ] = None,
    rtt: Annotated[
        list[str] | None,
        typer.Option(
            "--rtt",
            metavar="A:B=TIME",
            help="The round trip between these two nodes is this long, such as 40ms. Can be repeated.",
            autocompletion=complete_pairs,
        ),
    ] = None,
    apps: Annotated[
        list[Path] | None,
        typer.Option(
            "--app",
            metavar="FILE",
            help="The RobotApps of this file are applied (- for standard input), in place of those with their names. Can be repeated.",
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", metavar="FILE", help="The scheduler has this KubeSchedulerConfiguration.")
    ] = None,
    replay: Annotated[
        int,
        typer.Option(
            "--replay",
            metavar="N",
            min=0,
            max=500,
            help="With --config: judge the latest N placements under it and under the running configuration.",
        ),
    ] = 0,
    scheduler_url: SchedulerUrl = None,
    scheduler_namespace: SchedulerNamespace = SYSTEM_NAMESPACE,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Say which pods would move and which latency budgets would break, supposing all this at once; nothing is changed."""
    request = WhatIfRequest(
        node_loss=tuple(node_loss or ()),
        rtt=tuple(rtt or ()),
        apps=tuple(apps or ()),
        config=config,
        replay=replay,
        scheduler_url=scheduler_url,
        scheduler_namespace=scheduler_namespace,
    )
    run(
        Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output),
        lambda session: show_what_if(session, request),
    )


@app.command("domains", epilog="Example: kubectl robotapp domains -n fleet-a")
def domains_command(
    *,
    namespace: Annotated[
        str | None,
        typer.Option(
            "--namespace", "-n", help="Only domains held from this namespace (default: all).", callback=object_name
        ),
    ] = None,
    everywhere: Annotated[
        bool, typer.Option("--all-namespaces", "-A", help="All namespaces, which is the default.")
    ] = False,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Show the domain pools and who holds which DDS domain."""
    run(
        Options(namespace=None if everywhere else namespace, context=context, kubeconfig=kubeconfig, output=output),
        show_domains,
    )


@app.command("devices", epilog="Example: kubectl robotapp devices -o wide")
def devices_command(
    *,
    namespace: Annotated[
        str | None,
        typer.Option(
            "--namespace",
            "-n",
            help="Only free devices and those held from this namespace (default: all).",
            callback=object_name,
        ),
    ] = None,
    everywhere: Annotated[
        bool, typer.Option("--all-namespaces", "-A", help="All namespaces, which is the default.")
    ] = False,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Show the devices of all nodes and who holds them."""
    run(
        Options(namespace=None if everywhere else namespace, context=context, kubeconfig=kubeconfig, output=output),
        show_devices,
    )


@app.command("nodes", epilog="Example: kubectl robotapp nodes -o json")
def nodes_command(
    *, context: Context = None, kubeconfig: Kubeconfig = None, output: OutputFormat = Output.TABLE
) -> None:
    """Show all nodes: tier, zone, latency, devices, load, how old their agent's report is, since when they are offline."""
    run(Options(context=context, kubeconfig=kubeconfig, output=output), show_nodes)


@app.command("robots", epilog="Example: kubectl robotapp robots")
def robots_command(
    *, context: Context = None, kubeconfig: Kubeconfig = None, output: OutputFormat = Output.TABLE
) -> None:
    """Show all robots with the same, by their primary node."""
    run(Options(context=context, kubeconfig=kubeconfig, output=output), show_robots)


@app.command(
    "render", epilog="Examples: kubectl robotapp render teleop; kubectl robotapp render -f examples/teleop.yaml"
)
def render_command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]", help="A RobotApp in the cluster.", autocompletion=complete_names, callback=object_name
        ),
    ] = None,
    *,
    file: Annotated[
        Path | None, typer.Option("--file", "-f", help="A file with RobotApps (- for standard input).")
    ] = None,
    namespace: Namespace = None,
    context: Context = None,
    kubeconfig: Kubeconfig = None,
    output: OutputFormat = Output.YAML,
) -> None:
    """Show the children of a RobotApp in the cluster; with -f, what the API server would store (a dry run)."""
    options = Options(namespace=namespace, context=context, kubeconfig=kubeconfig, output=output)
    if (name is None) == (file is None):
        typer.echo("error: give a NAME, or -f FILE", err=True)
        raise typer.Exit(Exit.USAGE)
    if file is not None:
        run(options, lambda session: show_file(session, file))
    elif name is not None:
        run(options, lambda session: show_children(session, name))


@app.command(
    "lint",
    epilog="Examples: kubectl robotapp lint app.yaml; helm template my-robots | kubectl robotapp lint -; kubectl robotapp lint -o json deploy/*.yaml",
)
def lint_command(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FILE]...",
            help="YAML or JSON with RobotApps and DomainPools, or folders with such files (- for standard input).",
        ),
    ] = None,
    *,
    filenames: Annotated[
        list[Path] | None, typer.Option("--filename", "-f", help="The same as FILE. Can be repeated.")
    ] = None,
    output: OutputFormat = Output.TABLE,
) -> None:
    """Check files without a cluster: the schema, its rules and what the operator would refuse, with the line and the cure."""
    from robotapp_cli.commands.linting import show_lint  # the schema, jsonschema and CEL take half a second to import

    try:
        code = show_lint([*(files or ()), *(filenames or ())], output)
    except CliError as failure:
        raise ended_by(failure) from failure
    raise typer.Exit(code)


add_import_command(app)


@app.command("console", epilog="Examples: kubectl robotapp console; kubectl robotapp console --no-browser --port 8080")
def console_command(
    *,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port on 127.0.0.1 (default: a free one).")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser.")] = True,
    scheduler_url: SchedulerUrl = None,
    scheduler_config: Annotated[
        str,
        typer.Option(
            "--scheduler-config",
            metavar="[NAMESPACE/]NAME",
            help="ConfigMap with the scheduler's configuration (default: robotapp-system/robotapp-scheduler).",
        ),
    ] = "",
    context: Context = None,
    kubeconfig: Kubeconfig = None,
) -> None:
    """Watch the fleet, its apps and nodes in a browser and tune the scheduler, with your own rights, until Ctrl-C."""
    try:
        options = ConsoleOptions(
            kubeconfig=kubeconfig,
            context=context,
            port=port,
            browser=browser,
            scheduler_url=scheduler_url or "",
            scheduler_config=scheduler_config,
        )
        start_console(options)
    except CliError as failure:
        raise ended_by(failure) from failure


add_working_commands(app)
add_bag_commands(app)
add_runs_command(app)


def main() -> None:
    """Entry point."""
    app()


if __name__ == "__main__":
    main()
