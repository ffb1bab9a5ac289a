"""`robotapp-agent --once`: what the agent sees on this machine, without a cluster."""

import time
from typing import Any, Final

import msgspec

from robotapp_agent.process.run import architecture
from robotapp_agent.report.changes import SHORTEST_INTERVAL_S
from robotapp_agent.report.knowledge import Knowledge
from robotapp_agent.report.status import shown, status_of
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_agent.shell.host.node_files import NodeFiles
from robotapp_agent.shell.options import Options

_BETWEEN_S: Final = 1.0
"""Load is an average over this time."""


def look(options: Options) -> tuple[dict[str, Any], str]:
    """The status as plain data, and what is wrong with the rules or could not be read ("" for nothing)."""
    files = NodeFiles(options.host_root)
    knowledge = Knowledge(
        arch=architecture(),
        realtime=files.realtime(),
        seq=0,
        fixed_interval_s=options.interval_seconds or SHORTEST_INTERVAL_S,
    )
    knowledge.sampled(files.sample().load)
    paths = HostPaths.below(options.host_root)
    scan = DeviceScanner(paths, rules_path=options.device_rules, node=options.node_name).scan()
    time.sleep(_BETWEEN_S)
    sample = files.sample()
    knowledge.sampled(sample.load)
    knowledge.devices, knowledge.temperatures, knowledge.battery = scan.devices, sample.temperatures, sample.battery
    status = shown(status_of(knowledge.readings()))
    return {key: value for key, value in status.items() if key not in ("seq", "intervalSeconds")}, scan.problem


def as_json(status: dict[str, Any]) -> str:
    """Indented, in the order of the schema."""
    return msgspec.json.format(msgspec.json.encode(status), indent=2).decode()


def as_text(status: dict[str, Any]) -> str:
    """For people: one line per fact."""
    kernel = " (PREEMPT_RT)" if status.get("kernel", {}).get("realtime") else ""
    lines = [f"architecture  {status.get('arch', 'unknown')}{kernel}"]
    lines += [f"load          {_load(status.get('load', {}))}"]
    for reading in status.get("temperatures", ()):
        lines.append(f"temperature   {reading['name']} {reading['celsius']} °C")
    if battery := status.get("battery"):
        lines.append(f"battery       {battery['percent']} %{', on external power' if battery['charging'] else ''}")
    devices = status.get("devices", ())
    lines.append(f"devices       {len(devices) or 'none'}")
    lines += [_device(device) for device in devices]
    return "\n".join(lines)


def _load(load: dict[str, int]) -> str:
    names = (("cpu", "cpuPercent"), ("memory", "memoryPercent"), ("disk", "diskPercent"), ("gpu", "gpuPercent"))
    parts = [f"{name} {load[key]} %" for name, key in names if key in load]
    if "networkBps" in load:
        parts.append(f"network {load['networkBps'] / 1e6:.1f} Mbit/s")
    return ", ".join(parts) or "unknown"


def _device(device: dict[str, Any]) -> str:
    facts = [device[key] for key in ("model", "interface", "identity", "path") if device.get(key)]
    facts += [f"also {name}" for name in device.get("names", ())]
    return f"  {device['id']}  {device['type']}{': ' if facts else ''}{', '.join(facts)}"
