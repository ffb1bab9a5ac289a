"""Finds signs in pictures: histograms of gradients over a grid of windows, classified by a small neural network."""

import pickle
from pathlib import Path

import numpy as np
from sklearn.neural_network import MLPClassifier

from reference_detection.scene import KINDS, SIGN, Sign, draw_floor, draw_sign, paint

CELL = 8
BINS = 6
STRIDE = 4
NOTHING = "nothing"
CONFIDENCE = 0.8
PATCHES = 4000
_CELLS = SIGN // CELL


def find_gradients(picture):
    """Returns the strength of the gradient of each pixel in each of BINS directions."""
    down, right = np.gradient(picture.astype(np.float32))
    strength = np.hypot(down, right)
    direction = ((np.arctan2(down, right) % (2 * np.pi)) * BINS / (2 * np.pi)).astype(int) % BINS
    return strength[..., None] * (direction[..., None] == np.arange(BINS))


def sum_cells(gradients):
    """Returns sums over CELL x CELL pixels, beginning at every STRIDE-th pixel."""
    total = np.pad(gradients.cumsum(0).cumsum(1), ((1, 0), (1, 0), (0, 0)))
    sums = total[CELL:, CELL:] - total[:-CELL, CELL:] - total[CELL:, :-CELL] + total[:-CELL, :-CELL]
    return sums[::STRIDE, ::STRIDE]


def describe_windows(picture):
    """Returns a row of features for each window, and the rows and columns of windows."""
    cells = sum_cells(find_gradients(picture))
    step = CELL // STRIDE
    rows, columns = (size - step * (_CELLS - 1) for size in cells.shape[:2])
    parts = [
        cells[down * step : down * step + rows, right * step : right * step + columns]
        for down in range(_CELLS)
        for right in range(_CELLS)
    ]
    features = np.concatenate(parts, axis=-1).reshape(rows * columns, -1)
    # Of length 10: values near 1 are what the network's first steps are made for.
    return 10 * features / (np.linalg.norm(features, axis=1, keepdims=True) + 1e-6), rows, columns


def train(seed=1, patches=PATCHES):
    """Returns a model trained on generated patches: signs up to three pixels beside the middle, floor, and parts of signs."""
    random = np.random.default_rng(seed)
    rows, labels = [], []
    for _ in range(patches):
        label = str(random.choice([*KINDS, NOTHING]))
        floor = draw_floor(3 * SIGN, 3 * SIGN, random)
        kind = label if label != NOTHING else str(random.choice(KINDS))
        aside = random.integers(-3, 4, 2) if label != NOTHING else _step_aside(random)
        if label != NOTHING or random.random() < 0.7:
            paint(floor, draw_sign(kind, random), SIGN + int(aside[0]), SIGN + int(aside[1]), random)
        patch = np.clip(floor[SIGN : 2 * SIGN, SIGN : 2 * SIGN], 0, 255).astype(np.uint8)
        rows.append(describe_windows(patch)[0][0])
        labels.append(label)
    model = MLPClassifier(
        hidden_layer_sizes=(64,), early_stopping=True, n_iter_no_change=5, max_iter=60, random_state=seed
    )
    return model.fit(np.array(rows), labels)


def _step_aside(random):
    """Returns how far a sign lies beside a window that does not count as one with a sign."""
    while True:
        aside = random.integers(-SIGN, SIGN + 1, 2)
        if max(abs(aside)) >= 9:
            return aside


def detect(model, picture):
    """Returns the signs in a picture, the surest window of those that overlap."""
    features, _, columns = describe_windows(picture)
    chances = model.predict_proba(features)
    chances[:, list(model.classes_).index(NOTHING)] = 0.0
    best = chances.max(axis=1)
    signs = []
    for index in np.argsort(-best):
        if best[index] < CONFIDENCE:
            break
        row, column = divmod(int(index), columns)
        sign = Sign(str(model.classes_[chances[index].argmax()]), column * STRIDE + SIGN / 2, row * STRIDE + SIGN / 2)
        if all(max(abs(sign.x - other_sign.x), abs(sign.y - other_sign.y)) >= SIGN * 0.75 for other_sign in signs):
            signs.append(sign)
    return signs


def count_hits(truth, signs, within=SIGN / 3):
    """Returns how many signs of the truth were detected with their kind, each by one detection."""
    remaining_signs = list(signs)
    hits = 0
    for sign in truth:
        near_signs = [
            s for s in remaining_signs if s.kind == sign.kind and max(abs(s.x - sign.x), abs(s.y - sign.y)) <= within
        ]
        if near_signs:
            remaining_signs.remove(near_signs[0])
            hits += 1
    return hits


def load(path):
    """Reads a model that `train` made at build time, in the same image."""
    with Path(path).open("rb") as file:
        return pickle.load(file)  # noqa: S301 - our own, part of the image


def main():
    """python3 -m reference_detection.detector FILE: trains the model and writes it to a file."""
    import sys

    with Path(sys.argv[1]).open("wb") as file:
        pickle.dump(train(), file)


if __name__ == "__main__":
    main()
