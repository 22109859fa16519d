"""Solid model of the robot of the paper. `make cad` builds it and writes the meshes and visuals of `assets/`.

Lengths in mm, masses in kg, moments of inertia in kg·m². `parameters` holds every dimension, `materials` every density;
`body`, `drive`, `keeper`, `omniwheel` and `ball` have one assembly each; `checks` tests that it can be built.
Only `parameters` and `materials` can be imported without CadQuery.
"""
