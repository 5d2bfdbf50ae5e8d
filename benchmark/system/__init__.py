"""What the suite asks of the machine below everything else: files that are whole or absent, and which code runs."""
