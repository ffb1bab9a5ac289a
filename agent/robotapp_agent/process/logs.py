"""The agent's log: the lines of all our programs, without the logger's name in those for people."""

from typing import Final

from robotapp_client.serving import logs

_TEXT: Final = "%(asctime)s %(levelname)-7s %(message)s"


def set_up(log_format: str, level: str) -> None:
    """From now on for the whole process."""
    logs.set_up(log_format, level, text=_TEXT)
