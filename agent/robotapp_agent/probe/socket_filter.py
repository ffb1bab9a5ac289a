"""The program by which the kernel drops datagrams that cannot be authentic, before the agent is woken for them. Pure.

It is classic BPF (Linux: Documentation/networking/filter.rst), which a process may attach to its own sockets without a privilege.
It compares what it takes no HMAC to know: size, version, kind, the id of the key, the receiver. What passes is still checked by
`open_packet`: the program is there for a flood, not for trust.

The kernel runs it on the datagram with its UDP header. A number is loaded from the datagram in network byte order.
"""

import struct
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from robotapp_agent.probe.packets import KEY_ID_AT, RECEIVER_AT, SIZE_BYTES, VERSION

UDP_HEADER_BYTES: Final = 8
WORD_BYTES: Final = 4
KEEP_ALL: Final = 0xFFFFFFFF

# Opcodes of linux/filter.h: class | size | mode.
LOAD_LENGTH: Final = 0x80  # BPF_LD | BPF_W | BPF_LEN
LOAD_BYTE: Final = 0x30  # BPF_LD | BPF_B | BPF_ABS
LOAD_WORD: Final = 0x20  # BPF_LD | BPF_W | BPF_ABS
JUMP_EQUAL: Final = 0x15  # BPF_JMP | BPF_JEQ | BPF_K
RETURN: Final = 0x06  # BPF_RET | BPF_K
_LAYOUT: Final = struct.Struct("=HBBI")  # struct sock_filter, in the byte order of the machine


class Instruction(NamedTuple):
    """One step. `skip_if` and `skip_unless`: how many steps a comparison leaves out when it holds, or when it does not."""

    opcode: int
    operand: int = 0
    skip_if: int = 0
    skip_unless: int = 0


def load_length() -> Instruction:
    """The accumulator becomes the size of the datagram with its UDP header."""
    return Instruction(LOAD_LENGTH)


def load_byte(at: int) -> Instruction:
    """The accumulator becomes the byte at this offset of the payload."""
    return Instruction(LOAD_BYTE, UDP_HEADER_BYTES + at)


def load_word(at: int) -> Instruction:
    """The accumulator becomes the four bytes at this offset of the payload."""
    return Instruction(LOAD_WORD, UDP_HEADER_BYTES + at)


def skip_if_equal(value: int, steps: int) -> Instruction:
    """Leave out the next steps when the accumulator is this value."""
    return Instruction(JUMP_EQUAL, value, skip_if=steps)


def skip_unless_equal(value: int, steps: int) -> Instruction:
    """Leave out the next steps when the accumulator is another value."""
    return Instruction(JUMP_EQUAL, value, skip_unless=steps)


def accept() -> Instruction:
    """The datagram goes to the socket, with all its bytes."""
    return Instruction(RETURN, KEEP_ALL)


def drop() -> Instruction:
    """The datagram is gone."""
    return Instruction(RETURN, 0)


def program(*, kind: int, receiver: bytes, key_ids: Iterable[bytes]) -> tuple[Instruction, ...]:
    """Accepts datagrams of this kind to this receiver that name one of the keys. Without keys it drops all."""
    steps = _require(load_length(), UDP_HEADER_BYTES + SIZE_BYTES)
    steps += _require(load_byte(0), VERSION) + _require(load_byte(1), kind)
    for at, value in _words(RECEIVER_AT, receiver):
        steps += _require(load_word(at), value)
    for key_id in key_ids:
        steps += _accept_if(_words(KEY_ID_AT, key_id))
    return (*steps, drop())


def machine_code(steps: Iterable[Instruction]) -> bytes:
    """The program as an array of `struct sock_filter`."""
    return b"".join(_LAYOUT.pack(step.opcode, step.skip_if, step.skip_unless, step.operand) for step in steps)


def instructions_in(code: bytes) -> int:
    """How many instructions the array has."""
    return len(code) // _LAYOUT.size


def _require(load: Instruction, value: int) -> list[Instruction]:
    return [load, skip_if_equal(value, 1), drop()]


def _accept_if(words: Sequence[tuple[int, int]]) -> list[Instruction]:
    """Falls through to what follows when one of the words is another."""
    steps = [accept()]
    for at, value in reversed(words):
        steps = [load_word(at), skip_unless_equal(value, len(steps)), *steps]
    return steps


def _words(at: int, content: bytes) -> list[tuple[int, int]]:
    """The offset and value of each word of a field."""
    return [
        (at + offset, int.from_bytes(content[offset : offset + WORD_BYTES], "big"))
        for offset in range(0, len(content), WORD_BYTES)
    ]
