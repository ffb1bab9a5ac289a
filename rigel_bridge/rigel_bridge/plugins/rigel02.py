"""`rigel deploy` of Rigel 0.2: `deploy: [{name: robotapp/rigel_bridge, kwargs: {…}}]` loads `rigel_bridge.Plugin`."""

from collections.abc import Callable
from typing import Any

from rigel_bridge.document.failures import BridgeError, printable
from rigel_bridge.plugins import work
from rigel_bridge.source import Source, objects


def failing(rigel_error: type[Exception]) -> Callable[[str, int], Exception]:
    """Makes errors that Rigel prints as one line and ends with: its own class, with our exit code.

    Rigel formats `base`, so a message with braces goes in as an argument.
    """

    def error(message: str, code: int) -> Exception:
        kind = type("RigelBridgeError", (rigel_error,), {"base": "{message}", "code": code})
        made: Exception = kind(message=printable(message))
        return made

    return error


def plugin(rigel_error: type[Exception]) -> type:
    """The class for an installed Rigel 0.2. It needs no base class of Rigel's: `run` and `stop` make a plugin there."""
    failed = failing(rigel_error)

    class Plugin:
        """Writes the RobotApp of ./Rigelfile; with `apply: true` or `wait: 120s` also into the cluster."""

        def __init__(self, *args: Any, **kwargs: Any) -> None:
            # Rigel hands over decoded settings only. Packages, vars and lines are in the file.
            self._args = args
            self._kwargs = kwargs

        def run(self) -> None:
            try:
                chosen = work.settings(self._kwargs, args=self._args)
                found = objects(Source(work.RIGELFILE))
                work.deploy_all(found, chosen, tell=work.tell)
            except BridgeError as error:
                raise failed(str(error), error.code) from None
            except Exception as error:  # Rigel would print a traceback
                raise failed(f"rigel_bridge has a bug: {type(error).__name__}: {error}", 1) from error

        def stop(self) -> None:
            """Nothing runs on: what was applied stays until `rigel-bridge delete`."""

    return Plugin
