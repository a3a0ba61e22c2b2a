"""Published figures and what is said of them, as experiments: runs, figures and claims as data."""
