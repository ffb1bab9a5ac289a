"""Small faults put into a copy of the product, and the test that notices each."""
