"""Signs of one picture as JSON, by the stamp of the picture in seconds and nanoseconds."""

import json

from reference_detection.scene import Sign


def write_signs(stamp, signs):
    """Returns the signs of one picture as JSON."""
    listed = [{"kind": sign.kind, "x": float(sign.x), "y": float(sign.y)} for sign in signs]
    return json.dumps({"stamp": [stamp.secs, stamp.nsecs], "signs": listed})


def read_signs(text):
    """Returns the stamp of a picture and its signs."""
    content = json.loads(text)
    return tuple(content["stamp"]), [Sign(**sign) for sign in content["signs"]]
