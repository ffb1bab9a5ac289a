"""Metadata of ConfigMaps and Secrets, without what is in them."""

import msgspec


class HeadMeta(msgspec.Struct, rename="camel", frozen=True, gc=False):
    name: str
    namespace: str
    uid: str = ""
    resource_version: str = ""


class Head(msgspec.Struct, frozen=True, gc=False):
    """A ConfigMap or Secret without what is in it."""

    metadata: HeadMeta
