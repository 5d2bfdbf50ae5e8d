"""What a user asks for, from Python or on the command line: functions that take values and return data."""
