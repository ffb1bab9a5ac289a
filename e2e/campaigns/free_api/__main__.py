"""Start one: prints its port as soon as it serves, and serves until it is killed."""

import argparse
import asyncio
import ssl
from pathlib import Path

import uvloop

from campaigns.free_api.server import FreeApi


async def serve(api: FreeApi, folder: Path) -> None:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(folder / "tls.crt", folder / "tls.key")
    server = await asyncio.get_running_loop().create_server(api.connection, "127.0.0.1", 0, ssl=tls)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m campaigns.free_api", description=__doc__)
    parser.add_argument("--nodes", type=int, default=5000)
    parser.add_argument("--placed", type=int, default=0, help="running pods, spread evenly over the nodes")
    parser.add_argument("--folder", type=Path, required=True, help="where tls.crt and tls.key are")
    arguments = parser.parse_args()
    uvloop.run(serve(FreeApi(nodes=arguments.nodes, placed=arguments.placed), arguments.folder))
