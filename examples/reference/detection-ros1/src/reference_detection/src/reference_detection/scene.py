"""Pictures of a floor with signs on it, generated from a seed: discs, squares and triangles on noise, and what is where."""

from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT = 320, 240
SIGN = 32
"""Side of the square that a sign fills, in pixels."""
KINDS = ("disc", "square", "triangle")
_MARGIN = 4


@dataclass(frozen=True)
class Sign:
    """A sign by its kind and the middle of it, in pixels."""

    kind: str
    x: float
    y: float


def draw_sign(kind, random):
    """Returns a mask of SIGN x SIGN that is 1 inside of the sign, turned and sized a little at random."""
    y, x = np.mgrid[0:SIGN, 0:SIGN] - (SIGN - 1) / 2
    angle, radius = random.uniform(-0.3, 0.3), random.uniform(11, 14)
    right_offset, down_offset = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
    if kind == "disc":
        return (right_offset**2 + down_offset**2 <= radius**2).astype(float)
    if kind == "square":
        return (np.maximum(abs(right_offset), abs(down_offset)) <= radius * 0.85).astype(float)
    return ((down_offset <= radius * 0.75) & (down_offset >= 2 * abs(right_offset) - radius)).astype(float)


def draw_floor(height, width, random):
    """Returns a floor of slow shades and noise, grey values between 0 and 255."""
    coarse = random.uniform(60, 120, (height // 40 + 2, width // 40 + 2))
    rows, columns = np.linspace(0, coarse.shape[0] - 1.001, height), np.linspace(0, coarse.shape[1] - 1.001, width)
    top, left = rows.astype(int), columns.astype(int)
    down_offset, right = (rows - top)[:, None], (columns - left)[None, :]
    upper = coarse[top][:, left] * (1 - right) + coarse[top][:, left + 1] * right
    lower = coarse[top + 1][:, left] * (1 - right) + coarse[top + 1][:, left + 1] * right
    return upper * (1 - down_offset) + lower * down_offset + random.normal(0, 6, (height, width))


def paint(floor, mask, top, left, random):
    """Paints a sign on the floor, brighter than what is below it."""
    patch = floor[top : top + SIGN, left : left + SIGN]
    patch += mask * random.uniform(60, 110)


def generate_frame(random, signs=3):
    """Returns a picture as uint8 and the signs in it, which do not overlap."""
    floor = draw_floor(HEIGHT, WIDTH, random)
    placed_signs = []
    while len(placed_signs) < signs:
        top = int(random.integers(_MARGIN, HEIGHT - SIGN - _MARGIN))
        left = int(random.integers(_MARGIN, WIDTH - SIGN - _MARGIN))
        middle_point = (left + SIGN / 2, top + SIGN / 2)
        if any(
            abs(middle_point[0] - sign.x) < SIGN * 1.2 and abs(middle_point[1] - sign.y) < SIGN * 1.2
            for sign in placed_signs
        ):
            continue
        kind = str(random.choice(KINDS))
        paint(floor, draw_sign(kind, random), top, left, random)
        placed_signs.append(Sign(kind, *middle_point))
    return np.clip(floor, 0, 255).astype(np.uint8), placed_signs
