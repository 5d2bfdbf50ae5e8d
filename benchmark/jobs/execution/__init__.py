"""Jobs become records: on this machine, in processes that may die, hang or be stopped at any time."""
