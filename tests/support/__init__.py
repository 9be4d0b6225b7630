"""Places, scans and jobs that tests of several rooms share."""
