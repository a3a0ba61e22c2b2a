"""One run on disk: its files, how they are written, read and resumed."""
