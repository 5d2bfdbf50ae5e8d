"""A paper of results: LaTeX from records, in a folder that one command compiles."""
