"""From a plan to records: what is to be done and how it is told apart, and the rooms where it is done."""
