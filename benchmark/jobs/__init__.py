"""From a plan to records: stages, runner, executors."""
