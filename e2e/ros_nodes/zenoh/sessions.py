"""Zenoh sessions that are opened as rmw_zenoh_cpp opens them: by the variables which the operator writes."""

import os
import time
from typing import Final

import zenoh

_RETRY_S: Final = 0.2


def open_session(mode: str) -> zenoh.Session:
    """Opens a session of this mode unless the environment names another one.

    A client needs its router; with `ZENOH_ROUTER_CHECK_ATTEMPTS` 0 it waits for it, with another value it fails without one.
    """
    waits = os.environ.get("ZENOH_ROUTER_CHECK_ATTEMPTS") == "0"
    while True:
        try:
            return zenoh.open(make_config(mode, os.environ.get("ZENOH_CONFIG_OVERRIDE", "")))
        except zenoh.ZError:
            if not waits:
                raise
            time.sleep(_RETRY_S)


def make_config(mode: str, override: str) -> zenoh.Config:
    """Returns the configuration of a session; `override` is text like `mode="client";connect/endpoints=["tcp/router:7447"]`."""
    config = zenoh.Config()
    settings = {"mode": f'"{mode}"', "scouting/multicast/enabled": "false"}
    settings |= dict(setting.split("=", 1) for setting in override.split(";") if setting.strip())
    for path, value in settings.items():
        config.insert_json5(path.strip(), value)
    return config
