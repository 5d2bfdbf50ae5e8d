"""Common parts of all trainings: plan, steps, batches made ahead, checkpoints, and the folder of a finished model."""
