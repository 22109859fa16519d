"""The time step of all measurements of engines."""

#: Time step of every engine, s, and time steps per action.
SIM_DT = 0.002
SUBSTEPS = 5
