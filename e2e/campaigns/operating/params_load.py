"""A program: follows the parameter files of many apps as the operator does, and prints what that cost.

python -m campaigns.operating.params_load KUBECONFIG APPS NAMES NAMESPACE...
"""

import asyncio
import dataclasses
import json
import os
import sys
from pathlib import Path

from tests.support.factories import make_app

from robotapp_client import ApiClient
from robotapp_client.transport.kubeconfig import load
from robotapp_operator.plan.spec.desired import App
from robotapp_operator.queue.workqueue import Queue
from robotapp_operator.watch.cache import Cache
from robotapp_operator.watch.config.config_maps import ParamsWatch

PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def rss_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES


def file_of(config_map: str) -> dict[str, object]:
    return {"configMapKeyRef": {"name": config_map, "key": "params.yaml"}}


def app(number: int, names: int, namespace: str) -> App:
    """An app whose every component names a ConfigMap of its own; none but the last may exist."""
    parts = [
        {"name": f"c{part}", "image": "x", "args": ["run"], "parameters": [file_of(f"absent-{number}-{part}")]}
        for part in range(names - 1)
    ]
    parts.append({"name": "real", "image": "x", "args": ["run"], "parameters": [file_of("present")]})
    return dataclasses.replace(make_app(*parts, uid=f"uid-{number}"), namespace=namespace)


async def follow(kubeconfig: Path, apps: int, names: int, namespaces: list[str]) -> dict[str, float]:
    made = [app(number, names, namespaces[number % len(namespaces)]) for number in range(apps)]
    async with ApiClient(load(kubeconfig), user_agent="params-load") as client:
        cache = Cache()
        watch = ParamsWatch(client, cache, Queue(clock=lambda: 0.0, jitter=lambda: 0.0), read_s=60)
        before = rss_bytes()
        task = asyncio.create_task(watch.run())
        for each in made:
            await watch.read(each, "")
        await asyncio.sleep(1)  # all watches stand
        after = rss_bytes()
        task.cancel()
        await asyncio.wait([task])
    return {"grown_mb": (after - before) / 1e6, "read": len(cache.config_maps)}


if __name__ == "__main__":
    path, count, each, *where = sys.argv[1:]
    print(json.dumps(asyncio.run(follow(Path(path), int(count), int(each), where))))
