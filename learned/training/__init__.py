"""What all trainings share: plan, steps, batches made ahead, checkpoints, and the folder of a finished model."""
