"""Kinds of options the benches share: what cannot work is refused before minutes are spent on it."""

import argparse
import os
from collections.abc import Callable
from pathlib import Path


def count(least: int, most: int = 10**6) -> Callable[[str], int]:
    """A whole number from `least` to `most`, as a `type` of argparse."""

    def read(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} to {most}")
        return int(text)

    return read


def amount(text: str) -> float:
    """A number from 0."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0")
    return value


def report(text: str) -> Path:
    """A file that can be written when all is done."""
    path = Path(text)
    if path.is_dir() or not os.access(path if path.exists() else path.absolute().parent, os.W_OK):
        raise argparse.ArgumentTypeError(f"{text} cannot be written: name a file in a folder that exists")
    return path
