"""Execution of jobs: plan, scheduler, workers, and many machines."""
