"""A paper of results: LaTeX from records, in a folder that compiles with one command."""
