"""Configurations for the tests of the scheduler's screen."""

import copy
from typing import Any

import yaml

from robotapp_api.model.names import OUR_SCHEDULERS
from robotapp_scheduler.config.model import API_VERSION, KIND

Document = dict[str, Any]


def build_document(**profile: Any) -> Document:
    """Both profiles, each with the same content."""
    profiles = [{"schedulerName": name, **copy.deepcopy(profile)} for name in OUR_SCHEDULERS]
    return {"apiVersion": API_VERSION, "kind": KIND, "profiles": profiles}


def build_text(**profile: Any) -> str:
    return yaml.safe_dump(build_document(**profile), sort_keys=False)


def enable(*names: str, **weights: int) -> Document:
    """Plugins without a weight, and with one."""
    entries = [{"name": name} for name in names]
    return {"enabled": entries + [{"name": name, "weight": weight} for name, weight in weights.items()]}


def disable(*names: str) -> Document:
    return {"disabled": [{"name": name} for name in names]}
