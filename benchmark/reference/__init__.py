"""Figures printed in the paper."""
