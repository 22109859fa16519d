"""The paper's robot as solids: `make cad` builds it, weighs it and writes the meshes and URDFs of `assets/`.

Lengths in mm, masses in kg, moments of inertia in kg·m². `parameters` holds every dimension, `materials` every density;
`body`, `drive`, `keeper`, `omniwheel` and `ball` hold one thing each; `checks` looks for what could not be built.
Only `parameters` and `materials` can be imported without CadQuery.
"""
