"""What the kernel does with a program of classic BPF, for the few instructions that ours have."""

from collections.abc import Sequence

from robotapp_agent.probe.socket_filter import (
    JUMP_EQUAL,
    LOAD_BYTE,
    LOAD_LENGTH,
    LOAD_WORD,
    RETURN,
    UDP_HEADER_BYTES,
    Instruction,
)

MOST_STEPS = 4096
"""The kernel refuses longer programs."""


def accepts(steps: Sequence[Instruction], payload: bytes) -> bool:
    """Does a UDP datagram with this payload reach the socket? IndexError for a program that jumps behind its end."""
    assert len(steps) <= MOST_STEPS
    packet = bytes(UDP_HEADER_BYTES) + payload
    accumulator = position = 0
    while True:
        step = steps[position]
        position += 1
        if step.opcode == RETURN:
            return step.operand > 0
        if step.opcode == LOAD_LENGTH:
            accumulator = len(packet)
        elif step.opcode in {LOAD_BYTE, LOAD_WORD}:
            end = step.operand + (1 if step.opcode == LOAD_BYTE else 4)
            if end > len(packet):
                return False
            accumulator = int.from_bytes(packet[step.operand : end], "big")
        else:
            assert step.opcode == JUMP_EQUAL
            skipped = step.skip_if if accumulator == step.operand else step.skip_unless
            assert 0 <= skipped <= 255, "a jump has eight bits"
            position += skipped
