"""The arguments and options that several commands of `kubectl robotapp` take."""

from pathlib import Path
from typing import Annotated

import typer

from robotapp_cli.completion import complete_components, complete_names, complete_robots
from robotapp_cli.output import Output
from robotapp_cli.written import address, object_name

Namespace = Annotated[
    str | None, typer.Option("--namespace", "-n", help="Namespace (default: the context's).", callback=object_name)
]
Everywhere = Annotated[bool, typer.Option("--all-namespaces", "-A", help="All namespaces.")]
Context = Annotated[str | None, typer.Option("--context", help="Context of the kubeconfig.")]
Kubeconfig = Annotated[
    Path | None, typer.Option("--kubeconfig", help="Kubeconfig file (default: $KUBECONFIG, ~/.kube/config).")
]
OutputFormat = Annotated[Output, typer.Option("--output", "-o", help="Form of the output.")]
Watching = Annotated[bool, typer.Option("--watch", "-w", help="Show it again whenever it changes, until Ctrl-C.")]
Name = Annotated[
    str,
    typer.Argument(metavar="NAME", help="Name of the RobotApp.", autocompletion=complete_names, callback=object_name),
]
Robot = Annotated[
    str | None,
    typer.Option(
        "--robot", help="Only the instance of this robot.", autocompletion=complete_robots, callback=object_name
    ),
]
SchedulerUrl = Annotated[
    str | None,
    typer.Option(
        envvar="ROBOTAPP_SCHEDULER_URL",
        help="Where the scheduler listens (default: kubectl port-forward to its pod).",
        callback=address,
    ),
]
SchedulerNamespace = Annotated[str, typer.Option(help="Namespace of the scheduler's pod.", callback=object_name)]
OptionalComponent = Annotated[
    str | None,
    typer.Argument(
        metavar="[COMPONENT]",
        help="Name of the component.",
        autocompletion=complete_components,
        callback=object_name,
    ),
]
