"""Child processes: start, communication, and end with all their descendants."""
