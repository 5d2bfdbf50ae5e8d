"""Services of the operating system: whole files, processes that may die alone, and digests of the code that runs."""
