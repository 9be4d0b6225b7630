"""Step 3: how much surface two scans share under a pose, both ways."""
