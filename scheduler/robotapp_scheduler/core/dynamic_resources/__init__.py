"""Dynamic resource allocation: the objects of resource.k8s.io/v1, the devices that nodes can reach, and the choice among them."""
