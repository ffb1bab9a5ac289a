"""The base class of plugins. A class that does not inherit from it is refused."""

from typing import Any


class Plugin:
    def __init__(
        self,
        raw_data: dict[str, Any],
        global_data: dict[str, Any],
        application: Any,
        providers_data: dict[str, Any],
        shared_data: dict[str, Any] = {},  # noqa: B006 (the contract's own default)
    ) -> None:
        self.raw_data = raw_data
        self.global_data = global_data
        self.application = application
        self.providers_data = providers_data
        self.shared_data = shared_data

    def setup(self) -> None: ...

    def start(self) -> None: ...

    def process(self) -> None: ...

    def stop(self) -> None: ...
