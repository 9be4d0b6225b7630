"""Initial alignment from pictures (the paper's step 2).

In: pictures whose pixels know their points. Out: the pose that matched keypoints agree on.
"""
