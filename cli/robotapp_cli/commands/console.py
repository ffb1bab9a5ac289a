"""`console`: starts the web console for the kubeconfig's user. It is a program of its own, with packages of its own."""

import importlib.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotapp_cli.failures import CliError, Exit

_NEEDED: Final = ("robotapp_console", "jinja2", "cryptography", "numpy")


@dataclass(frozen=True, slots=True)
class ConsoleOptions:
    """The options of the command."""

    kubeconfig: Path | None
    context: str | None
    port: int
    browser: bool
    scheduler_url: str = ""
    scheduler_config: str = ""


def start_console(options: ConsoleOptions) -> None:
    """Turns this process into the console, which ends with Ctrl-C. Raises CliError when it is not installed."""
    absent_packages = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if absent_packages:
        raise CliError(
            f"the console is not installed ({', '.join(absent_packages)} missing): pip install '.[cli,console]' in a clone",
            code=Exit.USAGE,
        )
    os.execv(sys.executable, build_command(options))  # noqa: S606 - our own program, without a shell


def build_command(options: ConsoleOptions) -> list[str]:
    """Returns the console's command line."""
    command = [sys.executable, "-m", "robotapp_console", "--local", f"--port={options.port}"]
    command += [f"--kubeconfig={options.kubeconfig}"] if options.kubeconfig else []
    command += [f"--context={options.context}"] if options.context else []
    command += [f"--scheduler-url={options.scheduler_url}"] if options.scheduler_url else []
    command += [f"--scheduler-config={options.scheduler_config}"] if options.scheduler_config else []
    return command if options.browser else [*command, "--no-browser"]
