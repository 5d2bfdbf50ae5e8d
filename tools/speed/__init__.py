"""``make speed``: this suite beside other programs, measured in one run and printed as one table."""
