"""What a user writes: the scene with its electrodes, supports, prescribed motions and loads.

A scene checks itself and knows nothing of forms, unknowns or solvers.  This room imports
`support`, `mesh` and `materials`.
"""
