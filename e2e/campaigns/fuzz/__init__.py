"""Random objects that fit their schema, thrown at a running product."""
