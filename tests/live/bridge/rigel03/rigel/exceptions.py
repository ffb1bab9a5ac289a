"""Errors that end a run with one line and status 1."""


class RigelError(Exception):
    def __init__(self, base: str) -> None:
        super().__init__(base)
