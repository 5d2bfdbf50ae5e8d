"""The static report: pages that work from a folder without a network, and load their data on demand."""
