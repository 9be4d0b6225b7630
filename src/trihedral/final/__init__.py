"""Step 4: a pose refined to the limit of the data."""
