"""Configuration of the programs and links of real nodes. Pure: text in, text out."""
