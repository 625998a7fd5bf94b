"""From a scene to unknowns, residual and tangent: the discrete problem.

This room imports `scene` and the rooms before it, and knows nothing of how a problem is solved.
"""
