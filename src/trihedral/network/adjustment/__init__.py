"""All stations placed at once by least squares.

In: links that agree, what is known beside the scans. Out: poses, covariances, residuals.
"""
