"""CM-BOF: canonical forms in, retrieval scores out."""
