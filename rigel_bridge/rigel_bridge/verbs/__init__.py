"""The commands of `rigel-bridge`, one module each; `table` lists them."""
