"""What the suite asks of the machine: whole files, processes that may die alone, and which code runs."""
