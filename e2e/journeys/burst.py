"""Step 6: operator and scheduler are killed in the middle of a burst; nothing is lost, doubled or left behind."""

import time
from collections import Counter
from typing import Any

from journeys.demo_cluster import DemoCluster, is_ready
from journeys.stage import Stage, wait_for
from robotapp_testbed.processes.process import wait_until

_APPS = 50
_READY_LIMIT_S = 300.0
"""Half a minute on a machine of its own; a busy one has needed 78 s."""
_CLAIMS_GONE_S = 60.0


def survive_kills(stage: Stage, demo: DemoCluster) -> None:
    stage.step(f"kill -9 of operator and scheduler in the middle of {_APPS} applications")
    names = [f"burst-{number:02}" for number in range(_APPS)]
    began_s = time.monotonic()
    demo.apply(*(_app(name) for name in names))
    wait_for("the first of them running", lambda: _ready(demo, names) >= 1, within_s=30)
    ready = _ready(demo, names)
    demo.operator.kill()
    demo.scheduler.kill()
    stage.say(f"killed both while {ready} of {_APPS} were Ready")
    demo.operator.start()
    demo.scheduler.start()
    _all_ready(stage, demo, names)
    stage.claim(f"all {_APPS} are Ready {time.monotonic() - began_s:.1f} s after the first was created", True)
    claims = [claim for claim in demo.items("robotclaims") if "domain" in claim["spec"]]
    domains = Counter((claim["spec"]["domain"]["pool"], claim["spec"]["domain"]["id"]) for claim in claims)
    stage.claim(f"{len(domains)} domains are claimed, none twice", max(domains.values()) == 1)
    holders = Counter((claim["spec"]["holder"]["uid"], claim["spec"]["holder"].get("instance", "")) for claim in claims)
    stage.claim("no application holds two domains", max(holders.values()) == 1)
    _delete(stage, demo, names)


def _all_ready(stage: Stage, demo: DemoCluster, names: list[str]) -> None:
    with stage.waiting("") as tell:

        def done() -> bool:
            ready = _ready(demo, names)
            tell(f"both start again: {ready} of {len(names)} applications are Ready")
            return ready == len(names)

        wait_for(f"all {len(names)} Ready", done, within_s=_READY_LIMIT_S, every_s=0.2)


def _delete(stage: Stage, demo: DemoCluster, names: list[str]) -> None:
    demo.kubectl("delete", "ra", "--wait=false", *names)
    began_s = time.monotonic()
    with stage.waiting("waiting for their claims to be given back"):
        gone = wait_until(lambda: not _left(demo), timeout_s=_CLAIMS_GONE_S, poll_s=0.2)
    took_s = time.monotonic() - began_s
    stage.claim(
        f"{took_s:.1f} s after deletion no claim of them is left (quarantine 1 s)", gone, ", ".join(_left(demo))
    )


def _left(demo: DemoCluster) -> list[str]:
    claims = demo.items("robotclaims")
    return [c["metadata"]["name"] for c in claims if c["spec"]["holder"]["name"].startswith("burst-")]


def _ready(demo: DemoCluster, names: list[str]) -> int:
    wanted = set(names)
    return sum(is_ready(app) for app in demo.items("robotapps") if app["metadata"]["name"] in wanted)


def _app(name: str) -> dict[str, Any]:
    components = [{"name": part, "image": "registry.example/burst:1"} for part in ("sense", "plan", "act")]
    return {
        "apiVersion": "robotics.io/v1alpha1",
        "kind": "RobotApp",
        "metadata": {"name": name},
        "spec": {"ros": {"distro": "humble"}, "components": components},
    }
