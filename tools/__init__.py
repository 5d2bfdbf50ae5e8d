"""Development tools: speed, publishing, figures, documentation."""
