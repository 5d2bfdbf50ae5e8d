"""What a user asks for, in Python or on the command line: functions that return data."""
