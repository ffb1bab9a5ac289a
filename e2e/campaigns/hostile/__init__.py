"""Attacks by people with small rights, or none, on the whole product: each in figures, with limits."""
