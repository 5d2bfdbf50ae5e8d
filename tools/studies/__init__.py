"""Measurements that a page tells of and no table: each is run by hand, and goes on where it was stopped."""
