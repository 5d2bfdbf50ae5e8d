"""The static report: pages that open from a folder without a network, with data in scripts that load when wanted."""
