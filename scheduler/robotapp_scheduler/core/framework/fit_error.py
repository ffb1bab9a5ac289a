"""FitError: the text of a pod that no node accepts, in kube-scheduler's words."""


def histogram(total: int, counts: dict[str, int]) -> str:
    """kube-scheduler's text for a pod no node accepts; entries are sorted as strings ("10 x" before "2 y")."""
    if total == 0:
        return "no nodes available to schedule pods"
    entries = sorted(f"{count} {reason}" for reason, count in counts.items() if count)
    return f"0/{total} nodes are available" + (f": {', '.join(entries)}." if entries else ".")


def pre_filter_message(total: int, text: str) -> str:
    """The text when a pre_filter rejected the pod."""
    return f"0/{total} nodes are available: {text}."
