"""What is known beside the scans: control points, fixed poses, level, pairs that a person decided on."""
