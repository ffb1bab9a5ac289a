"""Whether strangers at the scheduler's port cost pods anything: CPU per bind and latency beside bad tokens and `?full=1`.

Our scheduler and a standby copy of it against an API server that costs nothing. The same load goes to the copy and to
the one that binds, in turns within one run: the machine's mood, and what the load itself takes, are in both figures.
"""

import argparse
import asyncio
import json
import re
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from campaigns.common.figures import percentile
from campaigns.common.options import count, report
from campaigns.common.output import save, say
from campaigns.common.process_use import cpu_seconds
from campaigns.free_api.objects import NAMESPACE, pod_name
from campaigns.free_api.rig import Rig
from campaigns.free_api.server import GOOD_TOKEN
from robotapp_testbed.processes.process import Process

MOST_RISE: Final = 0.10
MOST_WAIT_MS: Final = 10.0
"""What a decision may take beyond the API server's own time."""
USERS: Final = 5
SERVER_MODULE: Final = "port.server_process"
PORT: Final = re.compile(r"explanations on port (\d+)")


def main(argv: Sequence[str] | None = None) -> int:
    options = _parser().parse_args(argv)
    result = asyncio.run(run(options))
    print(told(result))
    save(options.json, result)
    return 1 if options.check and result["missed"] else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="scripts/bench starve", description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=count(1), default=1000)
    parser.add_argument("--placed", type=count(1), default=10_000, help="running pods")
    parser.add_argument("--rate", type=count(1), default=300, help="pods per second")
    parser.add_argument("--seconds", type=count(1), default=20, help="of each turn")
    parser.add_argument("--turns", type=count(1), default=3, help="of each of the two")
    parser.add_argument("--bad", type=count(0), default=500, help="bad tokens per second")
    parser.add_argument("--full", type=count(0), default=50, help="?full=1 per second")
    parser.add_argument("--json", type=report, help="write every figure to this file")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a target is missed")
    return parser


async def run(options: argparse.Namespace) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        async with Rig(Path(folder), nodes=options.nodes, placed=options.placed) as rig:
            copy = rig.copy("idle")
            await asyncio.to_thread(copy.start)
            try:
                await _port(copy)
                await paced(rig, options, seconds=3)  # the first pods of a process find nothing cached
                turns: dict[str, list[dict[str, float]]] = {"idle copy": [], "scheduler": []}
                for number in range(options.turns):
                    for name, target in (("idle copy", copy), ("scheduler", rig.scheduler)):
                        turns[name].append(await turn(rig, target, options, seed=number))
                        say(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in turns[name][-1].items()))
            finally:
                await asyncio.to_thread(copy.stop)
    return judged(turns) | {"options": {key: value for key, value in vars(options).items() if key != "json"}}


async def turn(rig: Rig, target: Process, options: argparse.Namespace, *, seed: int) -> dict[str, float]:
    """Pods at a fixed rate while `target`'s port is under load."""
    url = f"https://127.0.0.1:{await _port(target)}"
    command = ["--seconds", options.seconds, "--bad", options.bad, "--full", options.full, "--seed", seed]
    command += ["--path", f"/explain/{NAMESPACE}/{pod_name(0)}"]
    command += [word for user in range(USERS) for word in ("--token", f"{GOOD_TOKEN}{user}")]
    load = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "campaigns.scheduler.port_load", url, *map(str, command), stdout=asyncio.subprocess.PIPE
    )
    try:
        figures = await paced(rig, options, seconds=options.seconds)
        answers = json.loads((await load.communicate())[0])
    finally:
        if load.returncode is None:
            load.kill()
            await load.wait()
    return figures | {f"{kind} {status}": n for kind, found in answers.items() for status, n in sorted(found.items())}


async def paced(rig: Rig, options: argparse.Namespace, *, seconds: int) -> dict[str, float]:
    pods = options.rate * seconds
    before_s, port_s = rig.cpu_s(), _served_s(rig.scheduler)
    await rig.order(f"pace?pods={pods}&rate={options.rate}&classes=20")
    ended = await rig.until(
        lambda seen: bool(seen["bound"] == pods and seen["running"] == pods and seen["events"] >= pods),
        within_s=seconds + 60,
    )
    waited = sorted(ended["waited_ms"])
    shares = {f"p{share:g} ms": percentile(waited, share) for share in (50, 99, 99.9)}
    served_s = _served_s(rig.scheduler) - port_s
    return {
        "CPU µs/pod": 1e6 * (rig.cpu_s() - before_s) / pods,
        **shares,
        "most ms": waited[-1],
        "port's process % of a core": 100 * served_s / seconds,
    }


def judged(turns: dict[str, list[dict[str, float]]]) -> dict[str, Any]:
    """Medians over the turns, and which target they miss."""
    middle = {
        name: {key: statistics.median(each[key] for each in found if key in each) for key in found[0]}
        for name, found in turns.items()
    }
    beside, under = middle["idle copy"], middle["scheduler"]
    rise = under["CPU µs/pod"] / beside["CPU µs/pod"] - 1
    waits_ms = under["p99 ms"] - beside["p99 ms"]
    missed = (
        [f"CPU per bind rises by {100 * rise:.1f} %, wanted at most {100 * MOST_RISE:g} %"] if rise > MOST_RISE else []
    )
    if waits_ms > MOST_WAIT_MS:
        missed.append(f"p99 from event to binding rises by {waits_ms:.1f} ms, wanted at most {MOST_WAIT_MS:g} ms")
    return {"turns": turns, "medians": middle, "rise": rise, "p99 rises ms": waits_ms, "missed": missed}


def told(result: dict[str, Any]) -> str:
    lines = []
    for name, figures in result["medians"].items():
        lines.append(f"load on the {name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures.items()))
    lines.append(f"CPU per bind rises by {100 * result['rise']:.1f} %, p99 by {result['p99 rises ms']:.2f} ms")
    return "\n".join([*lines, *(f"missed: {each}" for each in result["missed"])])


async def _port(process: Process) -> int:
    deadline_s = time.monotonic() + 60
    while not (found := PORT.search(process.log_text())):
        if time.monotonic() > deadline_s:
            raise TimeoutError(process.log_text()[-2000:])
        await asyncio.sleep(0.1)
    return int(found[1])


def _served_s(process: Process) -> float:
    """CPU of the process that serves the port; none where the one that binds does it itself. Copies come and go."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return sum(
        cpu_seconds(int(child)) for child in children if SERVER_MODULE in Path(f"/proc/{child}/cmdline").read_text()
    )


if __name__ == "__main__":
    sys.exit(main())
