"""From the chosen node to the bound pod."""
