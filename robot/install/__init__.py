"""Making a computer the robot's: environment, user, permissions, service; and undoing it.

A `plan` is a list of `changes`; each knows whether it is still needed, so that installing twice
changes nothing, and how to undo itself. What was done is kept in a manifest.
"""
