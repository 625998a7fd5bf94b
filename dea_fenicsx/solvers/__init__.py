"""Newton's method, the tangent, its factors and the scales of its residuals.

This room imports `model` and the rooms before it, and knows nothing of paths.
"""
