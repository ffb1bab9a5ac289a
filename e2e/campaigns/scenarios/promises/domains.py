"""Thesis §4.4.4, first part: every DDS domain has one holder."""

from campaigns.scenarios.promises.place import Place, Verdict, judged
from robotapp_api.model.names import Annotation

LEAST_TALKERS, MOST_TALKERS = 3, 6
IDS = range(1, 102)
"""What a bare pod may ask for by number (215 to 232 are allowed as well)."""


def automatic(place: Place) -> Verdict:
    """Pods on one node that ask for any domain get different ones, with a claim each."""
    node = place.rng.choice(place.cluster.nodes).name
    count = place.rng.randint(LEAST_TALKERS, MOST_TALKERS)
    talkers = [place.pod(f"talker-{index}", node=node, annotations=wants("auto")) for index in range(count)]
    names = place.create(*talkers)
    place.until_bound(names)
    domains = [place.granted(name, Annotation.GRANTED_DOMAIN) for name in names]
    if any(domains):
        place.until(lambda: len(place.claims()) >= count, what=lambda: f"{len(place.claims())} claims for {count} pods")
    holders = {str(each["spec"].get("domain", {}).get("id")): each["spec"]["holder"]["uid"] for each in place.claims()}
    kept = sum(
        bool(domain) and domains.count(domain) == 1 and holders.get(domain) == place.uid(name)
        for name, domain in zip(names, domains, strict=True)
    )
    return Verdict(kept, count, "" if kept == count else f"granted {domains}, claimed {sorted(holders)}")


def taken(place: Place) -> Verdict:
    """A domain by number: the second pod waits, is told who has it, and gets it when the first is gone."""
    number = str(place.rng.choice(IDS))
    (first,) = place.create(place.pod("first", annotations=wants(number)))
    place.until_bound([first])
    got = place.granted(first, Annotation.GRANTED_DOMAIN) == number
    (second,) = place.create(place.pod("second", annotations=wants(number)))
    place.until_settled([second])
    waited = not place.node_of(second)
    if waited:
        place.until_told(second, f"{place.namespace}/{first}")
        place.delete(first)
        place.until_bound([second])
    handed_on = waited and place.granted(second, Annotation.GRANTED_DOMAIN) == number
    return judged(
        {
            f"the first pod was not granted domain {number}": got,
            f"the second pod with domain {number} did not wait": waited,
            f"the second pod was not granted domain {number} afterwards": handed_on,
        }
    )


def wants(domain: str) -> dict[str, str]:
    """The annotation of a pod that asks for a domain."""
    return {str(Annotation.DDS_DOMAIN): domain}
