"""Step 2: hypotheses, several poses a pair, from every source that two prepared scans offer."""
