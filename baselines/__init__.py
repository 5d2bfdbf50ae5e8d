"""One file per classical method, to be read side by side with its paper."""
