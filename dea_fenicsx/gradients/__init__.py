"""Derivatives of what a run has measured, and of its critical loads, by constants and by shape.

`adjoint` brings them together; `functionals` says how an observable depends on the state,
`variables` by what it is derived, and `shapes` how the nodes of the mesh move.
"""
