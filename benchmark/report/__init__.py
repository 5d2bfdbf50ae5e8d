"""Tables, figures and pages of results: pure functions of records and of stored forms."""
