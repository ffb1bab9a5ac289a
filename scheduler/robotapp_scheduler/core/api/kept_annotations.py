"""Chooses which annotations of an object are kept: all of a few, of many those that a rule reads.

Tenants may write a quarter of a megabyte of annotations on each object, which would be two megabytes in memory.
"""

from typing import Final

from robotapp_api.model.names import Annotation

BETA_CLASS: Final = "volume.beta.kubernetes.io/storage-class"
BIND_COMPLETED: Final = "pv.kubernetes.io/bind-completed"
BOUND_BY_CONTROLLER: Final = "pv.kubernetes.io/bound-by-controller"
MIGRATED_PLUGINS: Final = "storage.alpha.kubernetes.io/migrated-plugins"
SELECTED_NODE: Final = "volume.kubernetes.io/selected-node"

MOST_KEYS: Final = 64
MOST_CHARACTERS: Final = 32_768
READ: Final = frozenset(annotation.value for annotation in Annotation) | {
    BETA_CLASS,
    BIND_COMPLETED,
    MIGRATED_PLUGINS,
    SELECTED_NODE,
}


def bound_annotations(annotations: dict[str, str]) -> dict[str, str]:
    """Returns the annotations themselves, or those that rules of ours read where there are more than an object needs."""
    if len(annotations) <= MOST_KEYS and sum(map(len, annotations.values())) <= MOST_CHARACTERS:
        return annotations
    return {key: value for key, value in annotations.items() if key in READ}
