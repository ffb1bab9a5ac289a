"""Step 6: operator and scheduler are killed in the middle of a burst; nothing is lost, doubled or left behind."""

import time
from collections import Counter
from typing import Any

from journeys.stage import Stage, wait_for
from journeys.world import World, is_ready
from robotapp_testbed.processes.process import wait_until

_APPS = 50
_READY_LIMIT_S = 300.0
"""Half a minute on a machine of its own; a busy one has needed 78 s."""
_CLAIMS_GONE_S = 60.0


def survive_kills(stage: Stage, world: World) -> None:
    stage.step(f"kill -9 of operator and scheduler in the middle of {_APPS} applications")
    names = [f"burst-{number:02}" for number in range(_APPS)]
    began_s = time.monotonic()
    world.apply(*(_app(name) for name in names))
    wait_for("the first of them running", lambda: _ready(world, names) >= 1, within_s=30)
    ready = _ready(world, names)
    world.operator.kill()
    world.scheduler.kill()
    stage.say(f"killed both while {ready} of {_APPS} were Ready")
    world.operator.start()
    world.scheduler.start()
    _all_ready(stage, world, names)
    stage.claim(f"all {_APPS} are Ready {time.monotonic() - began_s:.1f} s after the first was created", True)
    claims = [claim for claim in world.items("robotclaims") if "domain" in claim["spec"]]
    domains = Counter((claim["spec"]["domain"]["pool"], claim["spec"]["domain"]["id"]) for claim in claims)
    stage.claim(f"{len(domains)} domains are claimed, none twice", max(domains.values()) == 1)
    holders = Counter((claim["spec"]["holder"]["uid"], claim["spec"]["holder"].get("instance", "")) for claim in claims)
    stage.claim("no application holds two domains", max(holders.values()) == 1)
    _delete(stage, world, names)


def _all_ready(stage: Stage, world: World, names: list[str]) -> None:
    with stage.waiting("") as tell:

        def done() -> bool:
            ready = _ready(world, names)
            tell(f"both start again: {ready} of {len(names)} applications are Ready")
            return ready == len(names)

        wait_for(f"all {len(names)} Ready", done, within_s=_READY_LIMIT_S, every_s=0.2)


def _delete(stage: Stage, world: World, names: list[str]) -> None:
    world.kubectl("delete", "ra", "--wait=false", *names)
    began_s = time.monotonic()
    with stage.waiting("waiting for their claims to be given back"):
        gone = wait_until(lambda: not _left(world), timeout_s=_CLAIMS_GONE_S, poll_s=0.2)
    took_s = time.monotonic() - began_s
    stage.claim(
        f"{took_s:.1f} s after deletion no claim of them is left (quarantine 1 s)", gone, ", ".join(_left(world))
    )


def _left(world: World) -> list[str]:
    claims = world.items("robotclaims")
    return [c["metadata"]["name"] for c in claims if c["spec"]["holder"]["name"].startswith("burst-")]


def _ready(world: World, names: list[str]) -> int:
    wanted = set(names)
    return sum(is_ready(app) for app in world.items("robotapps") if app["metadata"]["name"] in wanted)


def _app(name: str) -> dict[str, Any]:
    components = [{"name": part, "image": "registry.example/burst:1"} for part in ("sense", "plan", "act")]
    return {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "metadata": {"name": name},
        "spec": {"ros": {"distro": "humble"}, "components": components},
    }
