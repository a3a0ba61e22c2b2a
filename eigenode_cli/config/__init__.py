"""Configuration: the typed schema, composition by Hydra, and every check of what the user typed."""
