"""Sweeps: many runs from one command, on several cores or a cluster, summarised whatever failed."""
