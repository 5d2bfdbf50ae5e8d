"""What a user sees: commands with their output, exit codes and files."""
