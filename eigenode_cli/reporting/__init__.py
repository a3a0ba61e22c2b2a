"""Figures and pages, from recorded files only."""
