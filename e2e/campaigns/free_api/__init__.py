"""An API server that costs nearly nothing, in a process of its own: against it our own costs can be seen.

Honest where it matters for a client: TLS, pages, one chunk per watch event, objects of real size, the watch events that
follow a bind. It checks and stores nothing but leases. `python -m campaigns.free_api --help` starts one by hand.
"""
