"""A temperature sensor on a serial port, which is opened again after it was unplugged.

The sensor sends a line per reading, framed as in NMEA 0183: `$T,21.43*52`. The two digits are the exclusive or of the
bytes between `$` and `*`, so that a line that was cut off by a plug counts for nothing.
"""

import os
import re
import termios
import tty

LONGEST_LINE = 80
RETRY_S = 1.0
_LINE = re.compile(rb"\$(T,(-?[0-9]{1,4}(?:\.[0-9]{1,6})?))\*([0-9A-F]{2})\r?")


def parse_reading(line):
    """Returns degrees Celsius, or None for a line that is not whole."""
    match = _LINE.fullmatch(line)
    if match is None or compute_checksum(match[1]) != int(match[3], 16):
        return None
    return float(match[2])


def compute_checksum(data):
    checksum = 0
    for byte in data:
        checksum ^= byte
    return checksum


class Sensor:
    """Reads the sensor; a timer of a node polls it. Prints when the device comes and goes, once each; times are seconds of one clock."""

    def __init__(self, path, baud_rate):
        self._path = path
        self._speed = find_speed(baud_rate)
        self._port = None
        self._retry_at_s = 0.0
        self._absence = ""
        self._rest = b""
        self._readings = 0

    def poll(self, now_s):
        """Returns the readings since the last poll, in degrees Celsius; none while there is no device."""
        if self._port is None and not self._connect(now_s):
            return []
        readings = [reading for line in self._read_lines() if (reading := parse_reading(line)) is not None]
        self._readings += len(readings)
        return readings

    def _connect(self, now_s):
        if now_s < self._retry_at_s:
            return False
        self._retry_at_s = now_s + RETRY_S
        try:
            self._port = open_port(self._path, self._speed)
        except OSError as error:
            if error.strerror != self._absence:
                self._absence = error.strerror
                print(f"no device at {self._path}: {error.strerror}; tried again every {RETRY_S:g} s", flush=True)
            return False
        self._absence, self._rest, self._readings = "", b"", 0
        print(f"connected to {self._path}", flush=True)
        return True

    def _read_lines(self):
        try:
            data = os.read(self._port, 4096)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._disconnect()
            return []
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-LONGEST_LINE:]
        return lines

    def _disconnect(self):
        # Closed at once: as long as somebody has it open, the kernel gives the device another number when it is back.
        os.close(self._port)
        self._port = None
        print(f"{self._path} was unplugged after {self._readings} readings", flush=True)


def find_speed(baud_rate):
    """Returns the constant of termios for a rate such as 115200."""
    speed = getattr(termios, f"B{baud_rate}", None)
    if speed is None:
        raise ValueError(f"baud_rate {baud_rate} is none of a serial port; write 9600, 19200, 57600 or 115200")
    return speed


def open_port(path, speed):
    """Opens a serial port for reading and drops what came before. Raises OSError."""
    port = os.open(path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        tty.setraw(port)
        attributes = termios.tcgetattr(port)
        attributes[4] = attributes[5] = speed
        termios.tcsetattr(port, termios.TCSANOW, attributes)
        termios.tcflush(port, termios.TCIFLUSH)
    except termios.error as error:  # which is no OSError
        os.close(port)
        raise OSError(*error.args) from error
    return port
