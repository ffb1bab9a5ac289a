"""Run as a script in the network namespace of a node: the probing half of the agent, commanded line by line.

    python -m campaigns.network.probing_node NAME PORT

Each line of the input is a round to make, `{"peers": {"b": "10.9.0.2"}, "seconds": 1}`; each line of the output is its result.
Answers the probes of other nodes until the input ends. The first line of the output is `{}`: the port is open.
"""

import asyncio
import json
import resource
import sys
from typing import Any

from tests.support.agent.probes import ring

from robotapp_agent.shell.udp import PeerAddress, UdpProbes


async def main(name: str, port: int) -> None:
    async with UdpProbes(own_name=name, keys=ring(), port=port) as probes:
        _print({})
        while line := await asyncio.to_thread(sys.stdin.readline):
            command = json.loads(line)
            peers = [PeerAddress(*peer) for peer in command["peers"].items()]
            before_s = _cpu_s()
            measured = await probes.round(peers, seconds=command["seconds"])
            results = {result.peer: result._asdict() for result in measured.results}
            _print({**measured._asdict(), "results": results, "cpu_s": _cpu_s() - before_s})


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _print(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
