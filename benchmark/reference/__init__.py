"""The figures printed in the paper."""
