"""Sets that other people made, in the layouts in which they are given out."""
