"""Runs of jobs: what is to be done, by which processes or machines, and what each job leaves."""
