"""Features and weights to a class with a probability."""

import math
from collections.abc import Iterable
from itertools import pairwise

from ros_profile.decide.classify.features import Features
from ros_profile.decide.classify.phrases import phrase
from ros_profile.decide.classify.weights import CALIBRATION, TEMPERATURE, WEIGHTS
from ros_profile.model.conclusions import Estimate, QosClass
from ros_profile.model.facts import Fact

CLASSES = (QosClass.REALTIME, QosClass.SENSOR_DATA, QosClass.SYSTEM_DEFAULT, QosClass.BEST_EFFORT)
_NONE = (0.0, 0.0, 0.0, 0.0)
MOST_EVIDENCE = 8


def scores(names: Iterable[str]) -> tuple[float, float, float, float]:
    """Summed weights per class, in the order of CLASSES."""
    total = list(WEIGHTS["bias"])
    for name in names:
        for index, weight in enumerate(WEIGHTS.get(name, _NONE)):
            total[index] += weight
    return (total[0], total[1], total[2], total[3])


def probabilities(total: tuple[float, ...]) -> tuple[float, ...]:
    highest = max(total)
    powers = [math.exp((score - highest) / TEMPERATURE) for score in total]
    return tuple(power / sum(powers) for power in powers)


def calibrated(probability: float) -> float:
    """Returns how often a class of this probability is right: a monotone table, linear between its rows."""
    for (low, right_low), (high, right_high) in pairwise(CALIBRATION):
        if probability <= high:
            return right_low + (right_high - right_low) * (probability - low) / (high - low)
    return CALIBRATION[-1][1]


def judged(found: Features) -> Estimate[QosClass] | None:
    """The most likely class; None when nothing of the unit speaks for any."""
    telling = [name for name in found.found if any(WEIGHTS.get(name, _NONE))]
    if not telling:
        return None
    likely = probabilities(scores(telling))
    best = max(range(len(CLASSES)), key=lambda index: likely[index])
    for_it = sorted((n for n in telling if _lead(n, best) > 0), key=lambda n: -_lead(n, best))
    evidence: dict[tuple[str, str, str], Fact] = {}
    for fact in (_one(found, name, best) for name in for_it):
        evidence.setdefault((fact.kind, fact.subject, fact.place), fact)
    reason = ", ".join(phrase(name) for name in for_it[:3]) if for_it else "nothing speaks against it"
    return Estimate(CLASSES[best], round(calibrated(likely[best]), 3), tuple(evidence.values())[:MOST_EVIDENCE], reason)


def _lead(name: str, best: int) -> float:
    """How far a feature puts the class ahead of the mean of the others."""
    weights = WEIGHTS[name]
    return weights[best] - (sum(weights) - weights[best]) / 3


def _one(found: Features, name: str, best: int) -> Fact:
    fact = found.found[name][0]
    weight = round(min(1.0, _lead(name, best) / 4), 2)
    return Fact(fact.kind, fact.subject, fact.value, fact.file, fact.line, weight)
