"""Random topologies and apps with budgets, placed by several schedulers, and what HiGHS proves of them."""
