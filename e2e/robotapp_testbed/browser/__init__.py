"""A real browser, and the console that it looks at."""

from robotapp_testbed.browser.local_console import LocalConsole, start_console

__all__ = ["LocalConsole", "start_console"]
