"""A plugin of somebody else's was broken off."""


class Overdue(BaseException):
    """Raised inside a hook that does not come back (shell.watchdog). No `except Exception` of the plugin's stops it."""
