"""The generations of Rigelfiles: which one a file is, and what of it a deployment needs."""
