"""What a command is: `table` lists them, `main` builds the command line from them."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Verb:
    """One command. `run` gives the exit code; a BridgeError it raises becomes one line and that error's code."""

    name: str
    summary: str
    """One line of `rigel-bridge --help`."""
    description: str
    arguments: Callable[[argparse.ArgumentParser], None]
    """Adds the command's own flags."""
    run: Callable[[argparse.Namespace], int]
    examples: tuple[tuple[str, str], ...]
    """(command line, what it does) of `rigel-bridge COMMAND --help`, most wanted first."""
