"""Commissioning, which a person does at a cell before it runs by itself: teach its goals, check
that it is ready, rehearse a trial without touching anything."""
