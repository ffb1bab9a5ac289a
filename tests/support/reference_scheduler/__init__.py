"""kube-scheduler's filters and scores, one node at a time with plain integers.

Written from the contract, not from the product: it takes JSON objects as the API server stores them, imports nothing
of the product and knows no arrays, classes or caches. Slow and obvious on purpose.
"""
