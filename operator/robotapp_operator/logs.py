"""Log lines, as text for people or JSON for collectors; kopf's and aiohttp's go the same way."""

import logging

from robotapp_api.serving.logs import set_up


def configure(form: str) -> None:
    """`form` is text or json."""
    set_up(form, "INFO")
    logging.getLogger("kopf").setLevel(logging.WARNING)
