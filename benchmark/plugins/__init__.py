"""Methods by name, their scaffold, and the checks of their contract."""
