"""Numbers with units as people write them, and sums of them."""
