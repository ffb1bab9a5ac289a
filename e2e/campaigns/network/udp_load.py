"""Run as a script: send numbered datagrams at a steady rate, or count those that come. The socket is inherited by number.

    python udp_load.py send FD ADDRESS PORT PER_SECOND SIZE SECONDS
    python udp_load.py count FD SECONDS_OF_SILENCE

A process of its own each, so that sender, switch and receiver share the machine's cores like real programs. Prints the count.
"""

import socket
import sys
import time

_ROUND_S = 0.001
_FIRST_WITHIN_S = 60.0
"""A machine that is busy takes its time to start the sender."""


def send(file: socket.socket, address: tuple[str, int], *, per_second: float, size: int, seconds: float) -> int:
    began, sent, payload = time.monotonic(), 0, bytes(size)
    while (passed_s := time.monotonic() - began) < seconds:
        for _ in range(min(int(passed_s * per_second) - sent, 1000)):
            file.sendto(payload, address)
            sent += 1
        time.sleep(_ROUND_S)
    return sent


def count(file: socket.socket, *, silence_s: float) -> int:
    file.settimeout(_FIRST_WITHIN_S)
    received = 0
    buffer = bytearray(65_536)
    try:
        while True:
            file.recv_into(buffer)
            if not received:
                file.settimeout(silence_s)
            received += 1
    except TimeoutError:
        return received


def run_load() -> None:
    verb, descriptor, *rest = sys.argv[1:]
    with socket.socket(fileno=int(descriptor)) as file:
        if verb == "send":
            address, port, per_second, size, seconds = rest
            target = (address, int(port))
            done = send(file, target, per_second=float(per_second), size=int(size), seconds=float(seconds))
        else:
            done = count(file, silence_s=float(rest[0]))
    sys.stdout.write(f"{done}\n")


if __name__ == "__main__":
    run_load()
