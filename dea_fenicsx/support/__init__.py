"""What every room may use: errors, input checks, units, files, progress, signals, DOLFINx.

Nothing here knows of a device or of an actuator.  This room imports no other room.
"""
