"""A camera sends pictures and a detector finds the signs in them."""
