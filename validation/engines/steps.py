"""The time step that every engine is measured at."""

#: Time step of every engine, s, and steps of it in one action.
SIM_DT = 0.002
SUBSTEPS = 5
