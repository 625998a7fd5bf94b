"""Meshes and drawings that others have made: read safely, checked, and brought into usable cells.

For one rank alone, and without DOLFINx.  The order of work is that of the modules: `formats` reads
a file into gmsh and runs no command of it; `arrays` takes cells, regions and facets out of the
gmsh model and checks that they fit together; `completion` and `splitting` make cells of them that
can be computed on; `joining` looks for parts that touch and are not joined; `model` writes the
result back into gmsh.
"""
